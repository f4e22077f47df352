// Whether the console answers, and how old is what the page shows. The page asks the console four times in a second and
// a half; when it does not answer, everything is grey, nothing can be clicked, and the reason stands in the middle.
window.station = (() => {
  const ASK_EVERY_MS = 400, ANSWER_WITHIN_MS = 1000, LATE_MS = 1000, OLD_MS = 2000, KEPT_TRIPS = 20;
  const trips = [];
  let offset = 0, consoleId = null, failures = 0, deadSince = null, shownAt = null;

  const now = () => Date.now() + offset;

  function heard(asked, answer) {
    const trip = Date.now() - asked;
    trips.push({ trip, offset: answer.now * 1000 - (asked + trip / 2) });
    if (trips.length > KEPT_TRIPS) trips.shift();
    offset = trips.reduce((best, one) => (one.trip < best.trip ? one : best)).offset;
    if (consoleId !== null && consoleId !== answer.console) location.reload(); // another console at the same address
    consoleId = answer.console;
    failures = 0;
    if (deadSince !== null) revive();
  }

  async function ask() {
    const asked = Date.now(), limit = new AbortController();
    const timer = setTimeout(() => limit.abort(), ANSWER_WITHIN_MS);
    try {
      const answer = await fetch("/beat", { signal: limit.signal, cache: "no-store" });
      if (!answer.ok) throw new Error(answer.status);
      heard(asked, await answer.json());
    } catch (error) {
      failures += 1;
      const isRefused = error.message === "403";
      if (failures > 1 || limit.signal.aborted || isRefused) die(asked, isRefused);
    }
    clearTimeout(timer);
    setTimeout(ask, ASK_EVERY_MS);
  }

  function die(asked, isRefused) {
    deadSince ??= asked;
    document.body.classList.add("no-console");
    document.querySelector(".console-lost .hint").textContent = isRefused
      ? "It was started again with another token: open the address that it printed."
      : "A running trial is recorded to its end all the same. Start the console again if it has ended; " +
        "this page comes back by itself.";
  }

  function revive() {
    deadSince = null;
    document.body.classList.remove("no-console");
  }

  function paint() {
    if (deadSince !== null) {
      const seconds = Math.max(0, (Date.now() - deadSince) / 1000).toFixed(0);
      document.querySelector(".console-lost .since").textContent = `no answer for ${seconds} s: what you see is old`;
    }
    const age = document.querySelector(".age");
    if (!age) return;
    const old = shownAt === null ? null : Math.max(0, now() - shownAt);
    age.classList.toggle("late", old !== null && old > LATE_MS);
    document.body.classList.toggle("old-data", old !== null && old > OLD_MS);
    age.textContent = old === null ? "" : old > OLD_MS ? `WHAT YOU SEE IS ${(old / 1000).toFixed(1)} s OLD`
      : `shown ${(old / 1000).toFixed(1)} s ago`;
  }

  function build() {
    const lost = document.createElement("div");
    lost.className = "console-lost";
    lost.setAttribute("role", "alert");
    lost.innerHTML = '<div><div class="title">The console does not answer</div>' +
      '<div class="since"></div><div class="hint"></div></div>';
    document.body.append(lost);
    setInterval(paint, 100);
    ask();
  }

  const isTyping = () => document.activeElement?.matches("input, textarea");
  window.addEventListener("keydown", (event) => {
    if (deadSince !== null) { // a key must not wait in a queue and act when the console is back
      event.stopImmediatePropagation();
      event.preventDefault();
    } else if (event.key === "Escape" && isTyping()) {
      document.activeElement.blur(); // from here on the keys act again
    }
  }, true);
  // On the window, so that it comes after the framework has taken the key; at once, so that the next key is the note's.
  window.addEventListener("keydown", (event) => {
    const note = document.querySelector(".note input:not([disabled])");
    if (event.key === "m" && !event.ctrlKey && !event.altKey && !event.metaKey && note && !isTyping()) {
      event.preventDefault(); // no m in the note
      note.focus();
    }
  });
  document.addEventListener("DOMContentLoaded", build);

  return {
    // One update of a trial's pictures; at is when its data left the recorder [Unix s].
    draw({ at, over_time, loop, markers }) {
      for (const [id, series] of [over_time, loop]) getElement(id)?.chart?.setOption({ series });
      window.drawMarkers?.(...markers);
      shownAt = at * 1000;
      paint();
      return true;
    },
    leave() { shownAt = null; },
  };
})();
