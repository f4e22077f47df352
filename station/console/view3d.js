// Points in three dimensions on a canvas: drag to rotate, wheel or two fingers to zoom, double click to reset.
window.view3d = (() => {
  const views = new WeakMap();
  const AXES = { z: ([x, y, z]) => [x, y, z], y: ([x, y, z]) => [-z, -x, y] }; // by the axis that points up: across, away, up

  const zoom = (view, factor) => { view.zoom = Math.max(0.3, Math.min(8, view.zoom * factor)); };

  // The view of a canvas; paint(canvas, view) draws it again. home: {turn, tilt} in radians; up: "y" or "z".
  function viewOf(canvas, paint, home, up) {
    if (views.has(canvas)) return views.get(canvas);
    const view = { ...home, zoom: 1, pointers: new Map(), centre: null, extent: 1, order: AXES[up] };
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
      Object.assign(view, home, { zoom: 1 });
      redraw();
    });
    new ResizeObserver(redraw).observe(canvas);
    return view;
  }

  // Centre and extent follow the points slowly, so that the view does not jump.
  function frame(view, points) {
    if (!points.length) return;
    const middle = [0, 1, 2].map((axis) => {
      const values = points.map((at) => at[axis]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    });
    view.centre = view.centre ? view.centre.map((old, axis) => old + 0.05 * (middle[axis] - old)) : middle;
    const extent = Math.max(...points.map((at) => Math.hypot(...at.map((x, axis) => x - view.centre[axis]))));
    view.extent = Math.max(extent, 0.98 * view.extent, 1);
  }

  // From a point to [across, down] in pixels. A point at the extent is within the canvas in every direction.
  function projector(canvas, view) {
    const size = Math.min(canvas.clientWidth, canvas.clientHeight);
    const scale = (0.45 * size * view.zoom) / view.extent;
    const [c, s, ct, st] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
    return (at) => {
      const [x, y, z] = view.order(at.map((value, axis) => value - view.centre[axis]));
      const across = c * x - s * y, away = s * x + c * y;
      return [canvas.clientWidth / 2 + scale * across, canvas.clientHeight / 2 - scale * (ct * z + st * away)];
    };
  }

  // The canvas cleared at the resolution of the screen; null while it is not visible.
  function cleared(canvas) {
    const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio || 1];
    if (!width || !height) return null;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  return { viewOf, frame, projector, cleared };
})();
