// The markers of a trial in three dimensions: drag turns, the wheel or two fingers zoom, a double click resets.
(() => {
  const COLOURS = { anchor: "#2c3640", cuff: "#a83a00", rope: "#0b4f9e", other: "#80889a" };
  const FLAT = 0.22, views = new WeakMap();

  function viewOf(canvas) {
    if (views.has(canvas)) return views.get(canvas);
    const view = { turn: 0.7, tilt: FLAT, zoom: 1, points: [], fingers: new Map(), middle: null, reach: 1 };
    views.set(canvas, view);
    const again = () => paint(canvas, view);
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      view.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = view.fingers.get(event.pointerId);
      if (!before) return;
      const others = [...view.fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (others.length) {
        const distance = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]) || 1;
        zoom(view, distance([event.clientX, event.clientY]) / distance(before));
      } else {
        view.turn += (event.clientX - before[0]) * 0.01;
        view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + (event.clientY - before[1]) * 0.01));
      }
      view.fingers.set(event.pointerId, [event.clientX, event.clientY]);
      again();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => view.fingers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(view, Math.exp(-event.deltaY * 0.001));
      again();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => {
      Object.assign(view, { turn: 0.7, tilt: FLAT, zoom: 1 });
      again();
    });
    new ResizeObserver(again).observe(canvas);
    return view;
  }

  const zoom = (view, factor) => { view.zoom = Math.max(0.3, Math.min(8, view.zoom * factor)); };

  // The middle and the reach follow the markers slowly, so that the picture does not jump.
  function frame(view) {
    const seen = view.points.filter((point) => point.at).map((point) => point.at);
    if (!seen.length) return;
    const mean = [0, 1, 2].map((axis) => seen.reduce((sum, at) => sum + at[axis], 0) / seen.length);
    view.middle = view.middle ? view.middle.map((old, axis) => old + 0.05 * (mean[axis] - old)) : mean;
    const reach = Math.max(...seen.map((at) => Math.hypot(...at.map((x, axis) => x - view.middle[axis]))));
    view.reach = Math.max(reach, 0.98 * view.reach, 1);
  }

  function projector(canvas, view) {
    const size = Math.min(canvas.clientWidth, canvas.clientHeight);
    const scale = (0.55 * size * view.zoom) / view.reach;
    const [c, s, ct, st] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
    return (at) => {
      const [x, y, z] = at.map((value, axis) => value - view.middle[axis]);
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
    const ink = canvas.getContext("2d");
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    ink.clearRect(0, 0, width, height);
    ink.font = "15px sans-serif";
    ink.fillStyle = COLOURS.anchor;
    if (!view.middle) return ink.fillText("markers: no frames yet", 10, 22);
    const place = projector(canvas, view);
    const placed = view.points.filter((point) => point.at).map((point) => ({ ...point, at: place(point.at) }));
    const line = (points, colour, isClosed) => {
      ink.beginPath();
      points.forEach(({ at }, number) => (number ? ink.lineTo(...at) : ink.moveTo(...at)));
      if (isClosed) ink.closePath();
      [ink.strokeStyle, ink.lineWidth] = [colour, 2];
      ink.stroke();
    };
    const of = (role) => placed.filter((point) => point.role === role);
    line(of("anchor"), "#2c364060", true);
    line([...of("cuff").slice(0, 1), ...of("rope")], COLOURS.rope, false);
    for (const { at, role } of placed) {
      ink.beginPath();
      ink.arc(...at, role === "cuff" ? 7 : 5, 0, 2 * Math.PI);
      ink.fillStyle = COLOURS[role];
      ink.fill();
    }
    names(ink, [...of("cuff"), ...of("rope"), ...of("anchor")]);
    axes(ink, view, height);
  }

  // A name that would cover another one, or a marker, is left out.
  function names(ink, placed) {
    const taken = placed.map(({ at }) => [at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5]);
    for (const { at, role, name } of placed) {
      const box = [at[0] + 9, at[1] - 18, at[0] + 9 + ink.measureText(name).width, at[1] - 4];
      if (taken.some((one) => box[0] < one[2] && one[0] < box[2] && box[1] < one[3] && one[1] < box[3])) continue;
      taken.push(box);
      ink.fillStyle = COLOURS[role];
      ink.fillText(name, at[0] + 9, at[1] - 6);
    }
  }

  function axes(ink, view, height) {
    const turned = projector({ clientWidth: 72, clientHeight: 72 }, { ...view, middle: [0, 0, 0], reach: 1.4, zoom: 1 });
    [ink.strokeStyle, ink.fillStyle, ink.lineWidth] = [COLOURS.other, COLOURS.other, 1.5];
    for (const [name, axis] of [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]]) {
      const [from, to] = [turned([0, 0, 0]), turned(axis)].map(([x, y]) => [x, y + height - 72]);
      ink.beginPath();
      ink.moveTo(...from);
      ink.lineTo(...to);
      ink.stroke();
      ink.fillText(name, to[0] + 3, to[1] + 3);
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
