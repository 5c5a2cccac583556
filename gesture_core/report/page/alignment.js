// How the query was warped to both examples: film strips with what was matched, and the channels that differ most.
"use strict";
gesture.alignment = (() => {
  const { make, draw, number, examples } = gesture;
  const { scale, path, text } = gesture.plots;
  const PICTURES = 8, WIDE = 640, LINES = 28;

  // Pictures of a clip at even times, drawn one after the other into a strip.
  async function film(canvas, clip, seconds, mirrored, wanted) {
    if (!clip) return;
    const video = make("video", { src: `clips/${clip}`, muted: true, preload: "auto", playsinline: true });
    video.muted = true;
    await once(video, "loadeddata");
    const pen = canvas.getContext("2d"), side = canvas.width / PICTURES;
    for (let i = 0; i < PICTURES && wanted(); i++) {
      video.currentTime = Math.min(((i + 0.5) / PICTURES) * seconds, Math.max(0, video.duration - 0.05));
      await once(video, "seeked");
      pen.save();
      if (mirrored) { pen.translate((2 * i + 1) * side, 0); pen.scale(-1, 1); }
      pen.drawImage(video, i * side, 0, side, canvas.height);
      pen.restore();
    }
    video.removeAttribute("src");
  }

  function once(element, event) {
    return new Promise((done) => {
      element.addEventListener(event, done, { once: true });
      element.addEventListener("error", done, { once: true });
      setTimeout(done, 3000);
    });
  }

  function strip(clip, seconds, kind, mirrored, wanted) {
    const canvas = make("canvas", { width: 1280, height: 160, class: `film ${kind}`, "aria-hidden": "true" });
    film(canvas, clip, seconds, mirrored, wanted);
    return canvas;
  }

  // Grey lines between matched times; the query's edge is above or below.
  function threads(time, matched, seconds, length, up) {
    const svg = draw("svg", { viewBox: `0 0 ${WIDE} 46`, class: "threads", preserveAspectRatio: "none", "aria-hidden": "true" });
    for (let i = 0; i < LINES; i++) {
      const place = Math.round((i / (LINES - 1)) * (time.length - 1));
      const x = (time[place] / 1000 / seconds) * WIDE, z = (matched[place] / 1000 / length) * WIDE;
      svg.append(draw("line", { x1: x, x2: Math.max(0, Math.min(WIDE, z)), y1: up ? 46 : 0, y2: up ? 0 : 46, class: "thread" }));
    }
    return svg;
  }

  // One channel: the query, and both examples at its time.
  function channel(one, record, seconds, near, far) {
    const wide = 300, high = 160, left = 52, right = 8, top = 8, foot = 132;
    const all = [one.query, one.near ?? [], one.far ?? []].flat();
    const x = scale(0, seconds, left, wide - right), y = scale(Math.min(...all), Math.max(...all), foot, top);
    const svg = draw("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img", "aria-label": `${one.name} over the query's time` });
    const points = (values) => values.map((value, index) => [x.place(record.time[index] / 1000), y.place(value)]);
    svg.append(draw("line", { x1: left, x2: wide - right, y1: foot, y2: foot, class: "grid" }));
    for (const [value, place] of [[Math.min(...all), foot], [Math.max(...all), top + 7]]) svg.append(text(left - 4, place, value.toFixed(2), { class: "tick", "text-anchor": "end" }));
    if (one.far) svg.append(path(points(one.far), { class: "curve far" }));
    if (one.near) svg.append(path(points(one.near), { class: "curve near" }));
    svg.append(path(points(one.query), { class: "curve query" }));
    svg.append(text(0, 0, one.unit || "value", { class: "tick", "text-anchor": "middle", transform: `translate(9 ${(top + foot) / 2}) rotate(-90)` }));
    for (const tick of x.ticks) svg.append(text(x.place(tick), foot + 14, String(tick), { class: "tick", "text-anchor": "middle" }));
    svg.append(text((left + wide - right) / 2, foot + 26, "seconds of this input", { class: "tick", "text-anchor": "middle" }));
    const head = draw("line", { y1: top, y2: foot, class: "head" });
    svg.append(head);
    const costs = [one.near_cost === undefined ? "" : `${near} ${one.near_cost.toPrecision(2)}`, one.far_cost === undefined ? "" : `${far} ${one.far_cost.toPrecision(2)}`].filter(Boolean).join(", ");
    return { element: make("figure", { class: "channel" }, make("figcaption", {}, make("b", {}, one.name), make("span", { class: "dim" }, ` costs: ${costs}`)), svg), move: (at) => { for (const end of ["x1", "x2"]) head.setAttribute(end, x.place(at)); } };
  }

  // The whole picture, and what moves its playhead.
  function show(row, record, wanted) {
    const seconds = row.seconds || record.time[record.time.length - 1] / 1000 || 1;
    const near = record.near && examples[row.near], far = record.far && examples[row.far];
    const length = (one, side) => one.seconds || side.time[side.time.length - 1] / 1000 || 1;
    const heads = [];
    const strips = make("div", { class: "strips", hidden: !gesture.pictured });
    const name = (kind, title) => make("p", { class: `strip-name ${kind}` }, title);
    if (near) strips.append(name("near", `${near.label}, its nearest example${record.near.mirrored ? ", mirrored" : ""}, ${number(length(near, record.near), 1)} s`), strip(near.clip, near.seconds, "near", record.near.mirrored, wanted), threads(record.time, record.near.time, seconds, length(near, record.near), true));
    const middle = make("div", { class: "strip-query" }, strip(row.clip, seconds, "query", false, wanted), make("span", { class: "head", "aria-hidden": "true" }));
    heads.push((at) => middle.lastChild.style.setProperty("left", `${Math.min(100, (100 * at) / seconds)}%`));
    strips.append(middle);
    if (far) strips.append(threads(record.time, record.far.time, seconds, length(far, record.far), false), strip(far.clip, far.seconds, "far", record.far.mirrored, wanted), name("far", `${far.label}, the runner-up${record.far.mirrored ? ", mirrored" : ""}, ${number(length(far, record.far), 1)} s`));
    const channels = record.channels.map((one) => channel(one, record, seconds, near?.label, far?.label));
    heads.push(...channels.map((one) => one.move));
    const legend = make("p", { class: "legend" }, make("span", { class: "key query" }, "this input"), near ? make("span", { class: "key near" }, near.label) : null, far ? make("span", { class: "key far" }, far.label) : null);
    return {
      element: make("div", { class: "alignment" }, strips, make("h3", {}, "The channels that differ most"), legend, make("div", { class: "channels" }, ...channels.map((one) => one.element)),
        make("p", { class: "dim small" }, "Both examples are shown at the input's time; costs are parts of the distance.")),
      move: (at) => heads.forEach((one) => one(at)),
    };
  }

  return { show };
})();
