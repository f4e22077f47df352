// Heartbeat of the console and age of the data on the page. The page asks the console four times in 1.5 s; if it does not
// answer, the page turns grey, clicks and keys are blocked, and a notice shows the reason.
window.station = (() => {
  const POLL_INTERVAL_MS = 400, TIMEOUT_MS = 1000, LATE_MS = 1000, OLD_MS = 2000, KEPT_ROUND_TRIPS = 20;
  const roundTrips = [];
  let offset = 0, consoleId = null, failures = 0, lostSince = null, shownAt = null, shownWhat = "data";

  const now = () => Date.now() + offset;

  function handleAnswer(sent, answer) {
    const duration = Date.now() - sent;
    roundTrips.push({ duration, offset: answer.now * 1000 - (sent + duration / 2) });
    if (roundTrips.length > KEPT_ROUND_TRIPS) roundTrips.shift();
    offset = roundTrips.reduce((best, trip) => (trip.duration < best.duration ? trip : best)).offset;
    if (consoleId !== null && consoleId !== answer.console) location.reload(); // the console was restarted
    consoleId = answer.console;
    failures = 0;
    if (lostSince !== null) showConnected();
  }

  async function poll() {
    const sent = Date.now(), limit = new AbortController();
    const timer = setTimeout(() => limit.abort(), TIMEOUT_MS);
    try {
      const answer = await fetch("/beat", { signal: limit.signal, cache: "no-store" });
      if (!answer.ok) throw new Error(answer.status);
      handleAnswer(sent, await answer.json());
    } catch (error) {
      failures += 1;
      const isRefused = error.message === "403";
      if (failures > 1 || limit.signal.aborted || isRefused) showLost(sent, isRefused);
    }
    clearTimeout(timer);
    setTimeout(poll, POLL_INTERVAL_MS);
  }

  function showLost(sent, isRefused) {
    lostSince ??= sent;
    document.body.classList.add("no-console");
    document.querySelector(".console-lost .hint").textContent = isRefused
      ? "It was restarted with another token: open the address that it printed."
      : "A running trial is recorded to its end. Restart the console if it has ended; " +
        "this page then reconnects.";
  }

  function showConnected() {
    lostSince = null;
    document.body.classList.remove("no-console");
  }

  function render() {
    if (lostSince !== null) {
      const seconds = Math.max(0, (Date.now() - lostSince) / 1000).toFixed(0);
      document.querySelector(".console-lost .since").textContent = `no answer for ${seconds} s: this page shows old data`;
    }
    const age = document.querySelector(".age");
    if (!age) return;
    const old = shownAt === null ? null : Math.max(0, now() - shownAt);
    age.classList.toggle("late", old !== null && old > LATE_MS);
    document.body.classList.toggle("old-data", old !== null && old > OLD_MS);
    const isLive = shownWhat !== "data", seconds = (old / 1000).toFixed(isLive && old < LATE_MS ? 2 : 1);
    age.textContent = old === null ? "" : old > OLD_MS ? `${isLive ? "VALUES" : "DATA"} ARE ${seconds} s OLD`
      : `${shownWhat} ${seconds} s old`;
  }

  function build() {
    const lost = document.createElement("div");
    lost.className = "console-lost";
    lost.setAttribute("role", "alert");
    lost.innerHTML = '<div><div class="title">The console does not answer</div>' +
      '<div class="since"></div><div class="hint"></div></div>';
    document.body.append(lost);
    setInterval(render, 100);
    poll();
  }

  window.addEventListener("keydown", (event) => {
    if (lostSince === null) return;
    station.missKey?.(event); // a key must not be queued until the console answers again, nor be lost without a notice
    event.stopImmediatePropagation();
    event.preventDefault();
  }, true);
  window.addEventListener("dblclick", (event) => { // shows all of a zoomed chart again
    const chart = getElement(Number(event.target.closest(".nicegui-echart")?.id.slice(1)))?.chart;
    const batch = chart?.getOption().dataZoom.map((_, dataZoomIndex) => ({ dataZoomIndex, start: 0, end: 100 }));
    if (batch) chart.dispatchAction({ type: "dataZoom", batch });
  });
  document.addEventListener("DOMContentLoaded", build);

  return {
    now,
    // One update of the charts; at is the time at which its data left the recorder [Unix s].
    draw({ at, charts, markers }) {
      if (!charts.some(([id]) => getElement(id))) return true; // the trial has ended, and its view is gone
      if (!document.body.classList.contains("paused")) {
        for (const [id, series] of charts) getElement(id)?.chart?.setOption({ series });
        window.drawMarkers?.(...markers);
      }
      this.showAge(at * 1000, "data");
      return true;
    },
    // at: time of the data or values on the page [Unix ms]; what: they are, before their age.
    showAge(at, what) {
      [shownAt, shownWhat] = [at, what];
      render();
    },
    clearAge() {
      shownAt = null;
      document.body.classList.remove("paused");
    },
    // Paused charts can be read and scaled; force, time and age go on.
    togglePause() { document.body.classList.toggle("paused"); },
  };
})();
