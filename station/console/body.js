// A body in three dimensions: bones, muscles whose colour and width show their activation, cord and cuffs.
(() => {
  const BONE = "#7b8794", PLATE = "rgb(123 135 148 / 22%)", CAGE = "rgb(123 135 148 / 55%)", CORD = "#00715a", INK = "#2c3640";
  const HOME = { turn: 0.5, tilt: 0.15 };
  const THIN = 1.6, THICK = 8;
  // From pale to dark, so that activations differ in lightness too; a dark page inverts lightness.
  const SCALE = [[0, [150, 166, 190]], [0.25, [232, 160, 92]], [0.6, [204, 76, 2]], [1, [92, 16, 8]]];

  function colourOf(activation) {
    const level = Math.max(0, Math.min(1, activation || 0));
    const above = SCALE.findIndex(([at]) => at >= level), [to, high] = SCALE[above], [from, low] = SCALE[Math.max(0, above - 1)];
    const share = to > from ? (level - from) / (to - from) : 0;
    return `rgb(${low.map((value, i) => Math.round(value + share * (high[i] - value))).join(" ")})`;
  }

  function paint(canvas, view) {
    const context = view3d.cleared(canvas);
    if (!context) return;
    [context.lineCap, context.lineJoin] = ["round", "round"];
    if (view.centre && view.body) {
      const place = view3d.projector(canvas, view);
      for (const [kind, points] of view.body.bones) bone(context, kind, points.map(place));
      view.body.muscles.forEach((points, index) => {
        const level = view.body.levels[index];
        stroke(context, points.map(place), colourOf(level), THIN + (THICK - THIN) * Math.min(1, level || 0));
      });
      cord(context, view.body.cord.map(place));
    }
    legend(context, canvas.clientHeight);
  }

  function stroke(context, points, colour, width, dash = []) {
    context.beginPath();
    points.forEach((at, number) => (number ? context.lineTo(...at) : context.moveTo(...at)));
    [context.strokeStyle, context.lineWidth] = [colour, width];
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  function bone(context, kind, points) {
    stroke(context, points, kind === "cage" ? CAGE : BONE, { cage: 1, plate: 2, shaft: 7 }[kind]);
    if (kind !== "plate") return;
    context.fillStyle = PLATE;
    context.fill();
  }

  function cord(context, points) {
    if (!points.length) return;
    stroke(context, points, CORD, 3, [9, 5]);
    for (const at of [points[0], points.at(-1)]) {
      context.beginPath();
      context.rect(at[0] - 6, at[1] - 6, 12, 12);
      context.fillStyle = CORD;
      context.fill();
    }
  }

  function legend(context, height) {
    [context.font, context.fillStyle] = ["15px sans-serif", INK];
    const left = 10, width = 130, top = height - 26;
    for (let x = 0; x < width; x += 2) {
      context.fillStyle = colourOf(x / width);
      const thickness = THIN + (THICK - THIN) * (x / width);
      context.fillRect(left + x, top - thickness / 2 - 6, 2, thickness);
    }
    context.fillStyle = INK;
    context.fillText("activation 0 – 100 %", left, height - 8);
    stroke(context, [[left + 165, height - 13], [left + 195, height - 13]], CORD, 3, [9, 5]);
    context.fillText("cord", left + 201, height - 8);
  }

  // body: {bones: [[kind, points]], muscles: [points], levels: [activation or null], cord: points}, points [x, y, z] in mm
  window.drawBody = (id, body) => {
    const canvas = document.getElementById(id);
    if (!canvas) return;
    const view = view3d.viewOf(canvas, paint, HOME, "y");
    view.body = body;
    if (body) view3d.frame(view, body.bones.flatMap(([, points]) => points));
    paint(canvas, view);
  };
})();
