// One update of the live page: body, figures, bars and curves belong to the same frame.
(() => {
  const kept = new Map(); // curves by the id of their chart, which may not be drawn yet

  function addPoints(id, series, seconds) {
    const before = kept.get(id) || series.map(() => []);
    const curves = series.map((points, number) => [...before[number], ...points]);
    const last = Math.max(0, ...curves.map((points) => points.at(-1)?.[0] ?? 0));
    const first = Math.max(0, last - seconds);
    const shown = curves.map((points) => points.filter(([time]) => time >= first && time <= last));
    kept.set(id, shown);
    const xAxis = { min: first, max: Math.max(last, first + 1) };
    getElement(id)?.chart?.setOption({ series: shown.map((data) => ({ data })), xAxis });
  }

  // at: the time of the values [Unix s], from which the browser computes their age.
  window.station.drawLive = ({ at, lag, isOver, body, active, rows, recent, curves, seconds }) => {
    drawBody(...body);
    for (const [id, text] of [active, recent]) document.getElementById(id).textContent = text;
    for (const [id, text, width] of rows) {
      const cell = document.getElementById(id);
      cell.lastElementChild.textContent = text;
      cell.querySelector(".fill").style.width = `${100 * width}%`;
    }
    for (const [id, series] of curves) if (series.length) addPoints(id, series, seconds);
    if (isOver) station.clearAge(); // the last values of a trial that has ended are not late
    else station.showAge(1000 * at, `lag ${Math.round(1000 * lag)} ms · values`);
    return true;
  };
})();
