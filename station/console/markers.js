// The markers of a trial in three dimensions: drag to rotate, wheel or two fingers to zoom, double click to reset.
(() => {
  const COLOURS = {
    anchor: "#2c3640", cuff: "#a83a00", rope: "#0b4f9e", body: "#2c3640", arm: "#a83a00", suit: "#0b4f9e", other: "#80889a",
  };
  const FLAT = 0.22, views = new WeakMap();

  function viewOf(canvas) {
    if (views.has(canvas)) return views.get(canvas);
    const view = { turn: 0.7, tilt: FLAT, zoom: 1, points: [], pointers: new Map(), centre: null, extent: 1 };
    views.set(canvas, view);
    const redraw = () => paint(canvas, view);
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      view.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = view.pointers.get(event.pointerId);
      if (!before) return;
      const others = [...view.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (others.length) {
        const distance = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]) || 1;
        zoom(view, distance([event.clientX, event.clientY]) / distance(before));
      } else {
        view.turn += (event.clientX - before[0]) * 0.01;
        view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + (event.clientY - before[1]) * 0.01));
      }
      view.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      redraw();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => view.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(view, Math.exp(-event.deltaY * 0.001));
      redraw();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => {
      Object.assign(view, { turn: 0.7, tilt: FLAT, zoom: 1 });
      redraw();
    });
    new ResizeObserver(redraw).observe(canvas);
    return view;
  }

  const zoom = (view, factor) => { view.zoom = Math.max(0.3, Math.min(8, view.zoom * factor)); };

  // Centre and extent follow the markers slowly, so that the view does not jump.
  function frame(view) {
    const seen = view.points.filter((point) => point.at).map((point) => point.at);
    if (!seen.length) return;
    const mean = [0, 1, 2].map((axis) => seen.reduce((sum, at) => sum + at[axis], 0) / seen.length);
    view.centre = view.centre ? view.centre.map((old, axis) => old + 0.05 * (mean[axis] - old)) : mean;
    const extent = Math.max(...seen.map((at) => Math.hypot(...at.map((x, axis) => x - view.centre[axis]))));
    view.extent = Math.max(extent, 0.98 * view.extent, 1);
  }

  function projector(canvas, view) {
    const size = Math.min(canvas.clientWidth, canvas.clientHeight);
    const scale = (0.55 * size * view.zoom) / view.extent;
    const [c, s, ct, st] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
    return (at) => {
      const [x, y, z] = at.map((value, axis) => value - view.centre[axis]);
      const across = c * x - s * y, away = s * x + c * y;
      return [canvas.clientWidth / 2 + scale * across, canvas.clientHeight / 2 - scale * (ct * z + st * away)];
    };
  }

  function paint(canvas, view) {
    const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio || 1];
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "15px sans-serif";
    context.fillStyle = COLOURS.anchor;
    if (!view.centre) return context.fillText("markers: no frames yet", 10, 22);
    const place = projector(canvas, view);
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
    names(context, ["cuff", "rope", "anchor", "arm", "suit", "body"].flatMap(of));
    axes(context, view, height);
  }

  // A label that would cover another label or a marker is omitted.
  function names(context, placed) {
    const boxes = placed.map(({ at }) => [at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5]);
    for (const { at, role, name } of placed) {
      const box = [at[0] + 9, at[1] - 18, at[0] + 9 + context.measureText(name).width, at[1] - 4];
      if (boxes.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3])) continue;
      boxes.push(box);
      context.fillStyle = COLOURS[role];
      context.fillText(name, at[0] + 9, at[1] - 6);
    }
  }

  function axes(context, view, height) {
    const turned = projector({ clientWidth: 72, clientHeight: 72 }, { ...view, centre: [0, 0, 0], extent: 1.4, zoom: 1 });
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
    const view = viewOf(canvas);
    view.points = points;
    frame(view);
    paint(canvas, view);
  };
})();
