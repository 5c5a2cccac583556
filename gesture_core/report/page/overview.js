// Counts of labels and statuses, how certain they are, what a threshold would cost, and what was taken for what.
"use strict";
gesture.overview = (() => {
  const { data, rows, state, sureness, limits, show, make, draw, number, percent, counted, wilson, NOTHING } = gesture;
  const { scale, path, text } = gesture.plots;
  const known = rows.some((row) => row.truth !== null);
  const refresh = [];

  // Who answers row by row looks at rows: what is above them opens when it is wanted.
  const roomy = !data.review && matchMedia("(min-width: 621px)").matches;
  function card(title, ...children) {
    return make("details", { class: "card", open: roomy }, make("summary", {}, make("h2", {}, title)), ...children);
  }

  function tally(values) {
    const counts = new Map();
    for (const value of values) counts.set(value, (counts.get(value) ?? 0) + 1);
    return counts;
  }

  // A bar for each label, the statuses above them; each is a filter.
  function labels() {
    const statuses = tally(rows.map((row) => row.status));
    const chips = make("div", { class: "chips" });
    for (const status of ["ok", "degraded", "rejected", "skipped", "error"]) {
      if (!statuses.has(status)) continue;
      const chip = make("button", { type: "button", class: `chip ${status}`, onclick: () => show({ status: state.status === status ? "" : status }) },
        make("span", { class: "mark", "aria-hidden": "true" }), `${status} `, make("b", {}, statuses.get(status).toLocaleString("en")));
      refresh.push(() => chip.setAttribute("aria-pressed", state.status === status));
      chips.append(chip);
    }
    const counts = tally(rows.map((row) => row.label ?? NOTHING));
    for (const label of data.labels) if (!counts.has(label)) counts.set(label, 0);
    const most = Math.max(1, ...counts.values());
    const sorted = [...counts].sort((a, b) => (a[0] === NOTHING) - (b[0] === NOTHING) || b[1] - a[1] || (a[0] < b[0] ? -1 : 1));
    const list = make("ul", { class: counts.size > 8 ? "bars many" : "bars" });
    for (const [label, count] of sorted) {
      const button = make("button", { type: "button", onclick: () => show({ label: state.label === label ? "" : label, truth: null }) },
        make("span", { class: "bar-name" }, label === NOTHING ? "no label" : label),
        make("span", { class: "bar", "aria-hidden": "true" }, count > 0 && make("span", { style: { width: `${(100 * count) / most}%` }, class: label === NOTHING ? "fill empty" : "fill" })),
        make("span", { class: "bar-count" }, count.toLocaleString("en")));
      refresh.push(() => button.setAttribute("aria-pressed", state.label === label));
      list.append(make("li", {}, button));
    }
    return card("Labels", chips, list);
  }

  // Accuracy and coverage over the threshold, a histogram on the same axis, and the slider below both.
  function certainty() {
    const wide = 420, high = 176, left = 40, right = 46, foot = 142;
    const picture = make("div", { class: "plot" }), said = make("p", { class: "said", role: "status" });
    const slider = make("input", { type: "range", min: 0, max: 1000, class: "slider", "aria-label": "Threshold" });
    const setting = make("code", { class: "setting" });
    const reset = make("button", { type: "button", onclick: () => choose(null) }, "As in the run");
    const kinds = data.kind === "events" ? ["sure"] : ["sure", "distance"];
    const names = { sure: sureness, distance: "distance" };
    const switches = make("div", { class: "switch", role: "group", "aria-label": "Threshold on" });
    for (const kind of kinds) {
      const button = make("button", { type: "button", onclick: () => { state.threshold = { by: kind, value: null }; render(); show(); } }, names[kind]);
      refresh.push(() => button.setAttribute("aria-pressed", state.threshold.by === kind));
      switches.append(button);
    }
    let low = 0, top = 1, line = null, axis = null;

    function choose(value) {
      state.threshold = { ...state.threshold, value };
      show();
    }
    slider.addEventListener("input", () => choose(low + (slider.value / 1000) * (top - low)));

    function value(row) {
      return state.threshold.by === "distance" ? row.distance : row[sureness];
    }

    function render() {
      const by = state.threshold.by;
      const all = rows.filter((row) => row.best !== null && Number.isFinite(value(row)));
      const values = all.map(value).sort((a, b) => a - b);
      low = 0;
      top = by === "distance" ? values[Math.floor(0.995 * (values.length - 1))] * 1.05 || 1 : Math.max(data.margin_is === "distance" && sureness === "margin" ? 0 : 1, values[values.length - 1] ?? 1);
      axis = scale(low, top, left, wide - right);
      const bins = 30, counts = Array.from({ length: bins }, () => [0, 0]);
      for (const row of all) {
        const bin = Math.min(bins - 1, Math.floor(((value(row) - low) / (top - low)) * bins));
        counts[bin][known && row.truth !== null && row.best !== row.truth ? 1 : 0]++;
      }
      const most = Math.max(1, ...counts.map(([a, b]) => a + b));
      const svg = draw("svg", { viewBox: `0 0 ${wide} ${high}`, role: "img", "aria-label": `Histogram of the rows by ${names[by]}; lines: what a threshold would keep, and how much of it would be right` });
      const share = (part) => foot - part * (foot - 12);
      for (const part of [0, 0.5, 1]) {
        svg.append(draw("line", { x1: left, x2: wide - right, y1: share(part), y2: share(part), class: "grid" }),
          text(left - 6, share(part) + 4, `${100 * part} %`, { class: "tick", "text-anchor": "end" }));
      }
      // Bars have an axis of their own on the right: they are counted, lines are shares.
      const size = (count) => (count / most) * (foot - 12) * 0.62;
      for (const count of [0, most]) svg.append(text(wide - right + 6, foot - size(count) + 4, count.toLocaleString("en"), { class: "tick" }));
      svg.append(text(wide - right + 6, foot - size(most) - 10, "rows", { class: "tick" }));
      counts.forEach(([good, bad], bin) => {
        const x = axis.place(low + (bin / bins) * (top - low)), width = (wide - right - left) / bins - 1;
        svg.append(draw("rect", { x, width, y: foot - size(good), height: size(good), class: "histogram" }));
        if (bad) svg.append(draw("rect", { x, width, y: foot - size(good) - size(bad), height: size(bad), class: "histogram wrong" }));
      });
      const curve = [];
      for (let step = 0; step <= 60; step++) curve.push([low + (step / 60) * (top - low)]);
      const coverage = curve.map(([at]) => [axis.place(at), share(kept(at).coverage)]);
      svg.append(path(coverage, { class: "coverage" }));
      if (known) {
        const accuracy = curve.map(([at]) => [axis.place(at), kept(at)]).filter(([, one]) => one.known > 0);
        svg.append(path(accuracy.map(([x, one]) => [x, share(one.right / one.known)]), { class: "accuracy" }));
      }
      for (const tick of axis.ticks) svg.append(text(axis.place(tick), foot + 15, String(tick), { class: "tick", "text-anchor": "middle" }));
      svg.append(text((left + wide - right) / 2, foot + 31, title(by), { class: "tick", "text-anchor": "middle" }));
      line = draw("line", { y1: 6, y2: foot, class: "threshold" });
      svg.append(line);
      picture.replaceChildren(svg);
    }

    function title(by) {
      if (by === "distance") return "distance to the nearest example, 0: a copy";
      if (sureness === "score") return "score: how far an event is below the threshold";
      if (sureness === "confidence") return "confidence: probability that the label is right";
      return data.margin_is === "score" ? "margin: lead of the label's score over the next" : "margin: how much farther the next label is";
    }

    // What to type for a threshold; the score of an event is a share of what its setting allows.
    function typed(by, at) {
      if (by === "distance") return `--reject ${number(at)}`;
      if (sureness !== "score") return `--set classify.${sureness}=${number(at)}`;
      const [name, value] = data.spot;
      return `--set ${name}=${number(value * (1 - at))}`;
    }

    function kept(at) {
      const threshold = { by: state.threshold.by, value: at };
      let count = 0, withTruth = 0, right = 0;
      for (const row of rows) {
        if (!gesture.keeps(row, threshold)) continue;
        count++;
        if (row.truth !== null) [withTruth, right] = [withTruth + 1, right + (row.best === row.truth)];
      }
      return { count, coverage: count / Math.max(1, rows.length), known: withTruth, right };
    }

    refresh.push(() => {
      const { by, value: at } = state.threshold;
      const one = kept(at);
      const words = [`${counted(one.count, "row")} of ${rows.length.toLocaleString("en")} (${percent(one.coverage)}) ${at === null ? `${one.count === 1 ? "has" : "have"} a label` : "would keep their label"}`];
      if (known && one.known) {
        const [from, to] = wilson(one.right, one.known);
        words.push(`${percent(one.right / one.known)} of these are right (95 %: ${(100 * from).toFixed(1)} to ${percent(to)})`);
      }
      said.textContent = `${words.join("; ")}.`;
      const own = limits[by] > low && limits[by] <= top ? limits[by] : null;
      const here = at ?? own ?? (by === "distance" ? top : low);
      line.setAttribute("visibility", at === null && own === null ? "hidden" : "visible");
      line.setAttribute("class", at === null ? "threshold own" : "threshold");
      for (const end of ["x1", "x2"]) line.setAttribute(end, axis.place(here));
      slider.value = ((here - low) / (top - low)) * 1000;
      slider.setAttribute("aria-valuetext", at === null ? "as in the run" : `${names[by]} ${number(at)}`);
      setting.textContent = at === null ? "" : typed(by, at);
      setting.hidden = at === null;
      reset.hidden = at === null;
    });
    render();
    const legend = make("p", { class: "legend" }, make("span", { class: "key coverage" }, "keep their label"), known ? make("span", { class: "key accuracy" }, "of these right") : null,
      make("span", { class: "key bars-key" }, "rows"), known ? make("span", { class: "key wrong-key" }, "rows with a wrong label") : null);
    return card("Certainty and threshold", make("div", { class: "pair" }, make("div", {}, picture, slider), make("div", {}, kinds.length > 1 && switches, legend, said, make("p", { class: "setting-line" }, setting, reset))));
  }

  // Rows are what was performed, columns what was recognised; each cell is a filter.
  function confusion() {
    const tested = rows.filter((row) => row.truth !== null);
    const right = tested.filter((row) => row.right).length, [low, high] = wilson(right, tested.length);
    const truths = [...new Set(tested.map((row) => row.truth))].sort();
    const given = new Set(tested.map((row) => row.label ?? NOTHING));
    const columns = [...truths, ...[...given].filter((one) => one !== NOTHING && !truths.includes(one)).sort(), ...(given.has(NOTHING) ? [NOTHING] : [])];
    const counts = tally(tested.map((row) => JSON.stringify([row.truth, row.label ?? NOTHING])));
    const totals = tally(tested.map((row) => row.truth));
    const head = make("tr", {}, make("td", {}), ...columns.map((one) => make("th", { scope: "col" }, make("span", {}, one === NOTHING ? "no label" : one))));
    const body = truths.map((truth) => make("tr", {}, make("th", { scope: "row" }, truth), ...columns.map((label) => {
      const count = counts.get(JSON.stringify([truth, label])) ?? 0;
      if (count === 0) return make("td", {}, make("span", { class: "zero", "aria-label": "0" }, "·"));
      const share = count / totals.get(truth);
      const button = make("button", {
        type: "button", class: truth === (label === NOTHING ? "_none" : label) ? "cell right" : "cell wrong", style: { "--share": `${Math.round(12 + 88 * share)}%` }, "data-deep": share > 0.55,
        "aria-label": `${truth} recognised as ${label === NOTHING ? "nothing" : label}: ${count}`,
        onclick: () => (state.truth === truth && state.label === label ? show({ truth: null, label: "" }) : show({ truth, label })),
      }, String(count));
      refresh.push(() => button.setAttribute("aria-pressed", state.truth === truth && state.label === label));
      return make("td", {}, button);
    })));
    const figure = make("p", { class: "figure" }, make("b", {}, percent(right / tested.length)),
      ` right: ${right} of ${counted(tested.length, "row")}, 95 % interval ${(100 * low).toFixed(1)} to ${percent(high)}`);
    return card("Performed and recognised", figure, make("div", { class: "matrix", tabindex: "0", role: "region", "aria-label": "Confusion matrix" },
      make("table", {}, make("caption", { class: "unseen" }, "Rows: performed. Columns: recognised as."), make("thead", {}, head), make("tbody", {}, ...body))),
      make("p", { class: "dim small" }, "Rows: performed. Columns: recognised. A cell chooses its rows."));
  }

  // A track for each recording, an event where it is in time.
  function timeline() {
    const recordings = new Map();
    for (const row of rows) {
      if (!recordings.has(row.input)) recordings.set(row.input, []);
      if (row.event) recordings.get(row.input).push(row);
    }
    const tracks = document.getElementById("tracks");
    for (const [input, events] of recordings) {
      const some = rows.find((row) => row.input === input);
      const length = Math.max(some.length, ...events.map((row) => row.end), 0.001);
      const people = [...new Set(events.map((row) => row.person))].sort((a, b) => a - b);
      const track = make("div", { class: "track", style: { height: `calc(${Math.max(1, people.length)} * var(--lane))` } });
      for (const row of events) {
        const button = make("button", {
          type: "button", class: "event", title: `${row.label}, ${number(row.start, 2)} to ${number(row.end, 2)} s, score ${number(row.score, 2)}`,
          style: { left: `${(100 * row.start) / length}%`, width: `${(100 * (row.end - row.start)) / length}%`, top: `calc(${people.indexOf(row.person)} * var(--lane))`, "--sure": `${Math.round(35 + 65 * (row.score ?? 1))}%` },
          onclick: () => gesture.stage.choose(row, { scroll: true }),
        }, row.label);
        refresh.push(() => button.setAttribute("aria-pressed", state.chosen === row));
        track.append(button);
      }
      tracks.append(make("div", { class: "recording" }, make("p", { class: "track-name" }, make("span", {}, some.name), make("span", { class: "dim" }, `${counted(events.length, "event")} in ${number(length, 1)} s`)), track));
    }
    document.getElementById("timeline").hidden = false;
  }

  const place = document.getElementById("overview");
  if (data.kind !== "keypoints") place.append(labels(), certainty());
  else place.append(labels());
  if (known) place.append(confusion());
  if (data.kind === "events") timeline();
  gesture.listeners.add(() => refresh.forEach((one) => one()));
  return { refresh: () => refresh.forEach((one) => one()) };
})();
