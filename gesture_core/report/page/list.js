// The table: rows are drawn as they come into view, and their previews play while they are in it.
"use strict";
gesture.list = (() => {
  const { data, rows, state, sureness, make, number, distance } = gesture;
  const table = document.getElementById("table"), body = document.getElementById("body");
  const above = make("tr", { "aria-hidden": "true", class: "space" }, make("td"));
  const below = make("tr", { "aria-hidden": "true", class: "space" }, make("td"));
  const drawn = new Map();
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const most = (name) => rows.reduce((so_far, row) => Math.max(so_far, row[name] ?? 0), 1e-9);
  const longest = most("distance");
  const surest = data.margin_is === "distance" && sureness === "margin" ? most("margin") : 1;
  let first = 0, last = -1, height = 0, moving = 0;

  function bar(value, most, kind) {
    return make("span", { class: `gauge ${kind}`, "aria-hidden": "true" }, make("span", { style: { width: `${Math.max(0, Math.min(1, (value ?? 0) / most)) * 100}%` } }));
  }

  function clip(row) {
    if (!row.clip) return make("span", { class: "no-clip", title: row.missing || "no preview" }, "no preview");
    return gesture.film(row.clip, { loop: true, preload: "none", "data-src": `clips/${row.clip}` });
  }

  // What is known of a row beside its label, each with its kind.
  function remarks(row) {
    const found = [];
    if (row.status !== "ok") found.push([row.code || row.status, `status ${row.status}`]);
    if (row.label === null && row.best !== null) found.push([`nearest: ${row.best}`, "dim"]);
    if (row.right !== null) found.push(row.right ? ["✓ right", "right"] : [`✗ performed: ${row.truth}`, "wrong"]);
    const answer = gesture.review?.said(row);
    if (answer) found.push([answer, "answer"]);
    return found;
  }

  function spanned(row) {
    return `${number(row.start, 2)}–${number(row.end, 2)} s`;
  }

  function where(row) {
    const time = row.event ? spanned(row) : row.end === null ? "" : `${number(row.end - row.start, 1)} s`;
    return [row.folder, row.person ? `person ${row.person}` : "", time].filter(Boolean).join(" · ");
  }

  function line(row, place) {
    const second = remarks(row).map(([words, kind]) => make("span", { class: kind }, kind.startsWith("status") && make("span", { class: "mark", "aria-hidden": "true" }), words));
    return make("tr", { "aria-rowindex": place + 2, "aria-selected": state.chosen === row, tabindex: state.chosen === row ? "0" : "-1", "data-index": row.index, onclick: () => gesture.stage.choose(row, { open: true }) },
      make("td", { class: "c-clip", role: "gridcell" }, clip(row)),
      make("td", { class: "c-label", role: "gridcell" }, make("span", { class: row.label === null ? "label unlabelled" : "label", title: row.label }, row.label ?? "no label"), make("span", { class: "second" }, ...second), make("span", { class: "narrow dim" }, row.event ? `${spanned(row)} · ${row.file}` : row.file)),
      make("th", { class: "c-name", scope: "row" }, make("span", { class: "file", title: row.input }, row.file), make("span", { class: "second dim", title: row.input }, where(row))),
      make("td", { class: "c-sure", role: "gridcell" }, make("span", { class: "value" }, number(row[sureness])), bar(row[sureness], surest, "sure")),
      make("td", { class: "c-far", role: "gridcell" }, make("span", { class: "value" }, distance(row.distance)), bar(row.distance, longest, "far")));
  }

  // A row on paper: text alone, as ten thousand of them take a browser long enough.
  function plain(row) {
    const cell = (kind, words) => make("td", { class: kind }, words);
    return make("tr", { "data-index": row.index }, cell("c-label", [row.label ?? "no label", ...remarks(row).map(([words]) => words)].join(" · ")),
      make("th", { class: "c-name", scope: "row" }, [row.name, where({ ...row, folder: "" })].filter(Boolean).join(" · ")), cell("c-sure", number(row[sureness])), cell("c-far", distance(row.distance)));
  }

  // Draw what is in view, and a screen above and below.
  function render(again = false) {
    if (again) {
      for (const element of drawn.values()) element.remove();
      drawn.clear();
      last = -1;
    }
    const count = state.shown.length;
    if (!height) height = parseFloat(getComputedStyle(document.body).getPropertyValue("--row"));
    const start = table.getBoundingClientRect().top + table.tHead.offsetHeight;
    const from = Math.max(0, Math.floor((-start - innerHeight * 0.5) / height));
    const to = Math.min(count - 1, Math.ceil((-start + innerHeight * 1.5) / height));
    if (!again && from === first && to === last) return;
    [first, last] = [from, to];
    for (const [place, element] of drawn) {
      if (place < from || place > to) {
        element.querySelector("video")?.removeAttribute("src");
        element.remove();
        drawn.delete(place);
      }
    }
    if (!above.isConnected) body.append(above, below);
    let next = above;
    for (let place = from; place <= to; place++) {
      let element = drawn.get(place);
      if (!element) {
        element = line(state.shown[place], place);
        drawn.set(place, element);
        next.after(element);
      }
      next = element;
    }
    above.firstChild.style.height = `${from * height}px`;
    below.firstChild.style.height = `${Math.max(0, count - 1 - to) * height}px`;
    table.setAttribute("aria-rowcount", count + 1);
    clearTimeout(moving);
    moving = setTimeout(play, 90);
  }

  // Load and play what is really in view, once the page stands still.
  function play() {
    for (const element of drawn.values()) {
      const video = element.querySelector("video");
      if (!video) continue;
      const box = element.getBoundingClientRect(), seen = box.bottom > 0 && box.top < innerHeight;
      if (seen && !video.src) {
        video.src = video.dataset.src;
        video.preload = "auto";
      }
      if (seen && !calm.matches && !document.hidden) video.play().catch(() => {});
      else video.pause();
    }
  }

  function reveal(row) {
    const place = state.shown.indexOf(row);
    if (place < 0) return;
    const top = table.getBoundingClientRect().top + table.tHead.offsetHeight + place * height;
    const edge = document.getElementById("filters").getBoundingClientRect();
    const upper = getComputedStyle(document.getElementById("filters")).position === "sticky" ? edge.height + table.tHead.offsetHeight + 8 : 8;
    if (top < upper) scrollBy(0, top - upper);
    else if (top + height > innerHeight) scrollBy(0, top + height - innerHeight + 8);
    render();
  }

  function mark() {
    for (const element of drawn.values()) {
      const chosen = state.chosen !== null && Number(element.dataset.index) === state.chosen.index;
      element.setAttribute("aria-selected", chosen);
      element.tabIndex = chosen ? 0 : -1;
    }
  }

  // Everything, for a printer: the previews cannot be printed, the rows can.
  function printed() {
    for (const element of drawn.values()) element.remove();
    drawn.clear();
    above.remove();
    below.remove();
    state.shown.forEach((row, place) => drawn.set(place, plain(row)));
    body.append(...drawn.values());
  }

  addEventListener("scroll", () => render(), { passive: true });
  addEventListener("resize", () => { height = 0; render(true); });
  addEventListener("beforeprint", printed);
  addEventListener("afterprint", () => render(true));
  document.addEventListener("visibilitychange", play);
  calm.addEventListener("change", play);
  gesture.listeners.add(() => {
    const none = document.getElementById("none");
    none.hidden = state.shown.length > 0;
    none.textContent = rows.length ? "No row is like that." : "The run has no rows: nothing was finished yet, or its shard has no inputs.";
    render(true);
  });
  return { render, reveal, mark, redraw: () => render(true), focus: () => body.querySelector("[aria-selected=true]")?.focus({ preventScroll: true }) };
})();
