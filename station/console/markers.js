// The markers of a trial in three dimensions.
(() => {
  const COLOURS = {
    anchor: "#2c3640", cuff: "#a83a00", rope: "#0b4f9e", body: "#2c3640", arm: "#a83a00", suit: "#0b4f9e", other: "#80889a",
  };
  const HOME = { turn: 0.7, tilt: 0.22 };

  function paint(canvas, view) {
    const context = view3d.cleared(canvas);
    if (!context) return;
    context.font = "15px sans-serif";
    context.fillStyle = COLOURS.anchor;
    if (!view.centre) return context.fillText("markers: no frames yet", 10, 22);
    const place = view3d.projector(canvas, view);
    const placed = view.points.filter((point) => point.at).map((point) => ({ ...point, at: place(point.at) }));
    const line = (points, colour, isClosed) => {
      context.beginPath();
      points.forEach(({ at }, number) => (number ? context.lineTo(...at) : context.moveTo(...at)));
      if (isClosed) context.closePath();
      [context.strokeStyle, context.lineWidth] = [colour, 2];
      context.stroke();
    };
    const of = (role) => placed.filter((point) => point.role === role);
    line(of("anchor"), "#2c364060", true);
    line([...of("cuff").slice(0, 1), ...of("rope")], COLOURS.rope, false);
    line(of("arm"), COLOURS.arm, false);
    line(of("suit"), COLOURS.suit, false);
    for (const { at, role } of placed) {
      context.beginPath();
      context.arc(...at, role === "cuff" ? 7 : 5, 0, 2 * Math.PI);
      context.fillStyle = COLOURS[role];
      context.fill();
    }
    names(context, ["cuff", "rope", "anchor", "arm", "suit", "body"].flatMap(of), canvas.clientWidth);
    axes(context, view, canvas.clientHeight);
  }

  // A label that would cover another label or a marker is omitted.
  function names(context, placed, width) {
    const boxes = placed.map(({ at }) => [at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5]);
    for (const { at, role, name } of placed) {
      const long = context.measureText(name).width, left = at[0] + 9 + long <= width ? at[0] + 9 : at[0] - 9 - long;
      const box = [left, at[1] - 18, left + long, at[1] - 4];
      if (boxes.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3])) continue;
      boxes.push(box);
      context.fillStyle = COLOURS[role];
      context.fillText(name, left, at[1] - 6);
    }
  }

  function axes(context, view, height) {
    const turned = view3d.projector({ clientWidth: 72, clientHeight: 72 }, { ...view, centre: [0, 0, 0], extent: 1.15, zoom: 1 });
    [context.strokeStyle, context.fillStyle, context.lineWidth] = [COLOURS.other, COLOURS.other, 1.5];
    for (const [name, axis] of [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]]) {
      const [from, to] = [turned([0, 0, 0]), turned(axis)].map(([x, y]) => [x, y + height - 72]);
      context.beginPath();
      context.moveTo(...from);
      context.lineTo(...to);
      context.stroke();
      context.fillText(name, to[0] + 3, to[1] + 3);
    }
  }

  // points: [{name, role, at: [x, y, z] in mm or null}]
  window.drawMarkers = (id, points) => {
    const canvas = document.getElementById(id);
    if (!canvas) return;
    const view = view3d.viewOf(canvas, paint, HOME, "z");
    view.points = points;
    const own = points.filter((point) => point.role !== "other"); // the view fits the markers of the trial
    view3d.frame(view, (own.length ? own : points).filter((point) => point.at).map((point) => point.at));
    paint(canvas, view);
  };
})();
