// Small plots: lines over one axis, with their units.
"use strict";
gesture.plots = (() => {
  const { draw } = gesture;

  // A scale from values to pixels, and round values to write beside it.
  function scale(low, high, from, to) {
    const span = high - low || 1;
    const place = (value) => from + ((value - low) / span) * (to - from);
    const rough = span / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 2.5, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999);
    const ticks = [];
    for (let value = Math.ceil(low / step) * step; value <= high + step / 1e6; value += step) ticks.push(Number(value.toPrecision(6)));
    return { place, ticks };
  }

  function path(points, attributes) {
    const text = points.map(([x, y], index) => `${index ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
    return draw("path", { d: text, fill: "none", ...attributes });
  }

  function text(x, y, words, attributes = {}) {
    return draw("text", { x, y, ...attributes }, words);
  }

  return { scale, path, text };
})();
