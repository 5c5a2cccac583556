// The chosen row: the clip, the nearest example and the runner-up, moving together, and why.
"use strict";
gesture.stage = (() => {
  const { data, state, examples, sureness, pictured, make, number, distance } = gesture;
  const place = document.getElementById("stage");
  let turn = 0, opened = !pictured, shown = null;

  // The distance of an example comes with the alignment: its line is kept free for it.
  function panel(kind, title, subtitle, screen, example = null) {
    const name = example && (example.includes("://") ? example.split("::")[0] : example).split("/").pop();
    return make("figure", { class: `panel ${kind}` }, screen, make("figcaption", {}, make("b", { title }, title), make("span", { class: "dim" }, subtitle),
      example && make("span", { class: "dim where", title: example }, name), example && make("span", { class: "dim away" }, "\u00a0")));
  }

  function choose(row, { open = false, scroll = false } = {}) {
    state.chosen = row;
    if (scroll && !state.shown.includes(row)) gesture.show({ text: "", label: "", status: "", sure: "", answer: "", person: "", folder: "", truth: null });
    gesture.list.mark();
    gesture.overview.refresh();
    if (scroll) gesture.list.reveal(row);
    if (open) document.body.classList.add("staged");
    render(row);
  }

  function render(row) {
    const mine = ++turn, wanted = () => mine === turn;
    gesture.player.stop();
    if (!row) return place.replaceChildren();
    const near = row.near === null ? null : examples[row.near], far = row.far === null ? null : examples[row.far];
    const query = gesture.player.screen(row.clip, row.missing);
    const sides = [["near", near, "its nearest example"], ["far", far, "runner-up"]].filter(([, one]) => one);
    const screens = sides.map(([, one]) => gesture.player.screen(one.clip, "no preview"));
    const panels = make("div", { class: "panels" }, panel("query", row.label ?? "no label", "this input", query),
      ...sides.map(([kind, one, what], index) => panel(kind, one.label, what, screens[index], one.name)));
    const slider = make("input", { type: "range", min: 0, max: 1000, value: 0, class: "seek", "aria-label": "Time in the clip", oninput: () => { gesture.player.seek((slider.value / 1000) * (row.seconds || 1)); label(); } });
    const clock = make("span", { class: "clock" });
    const button = make("button", { type: "button", class: "play", onclick: () => { gesture.player.pause(); label(); } });
    const pace = make("select", { "aria-label": "Speed", onchange: () => gesture.player.pace(Number(pace.value)) }, ...[["1", "1×"], ["0.5", "½×"], ["0.25", "¼×"]].map(([value, words]) => make("option", { value }, words)));
    const label = () => { button.textContent = gesture.player.paused ? "Play" : "Pause"; };
    label();
    const why = make("details", { class: "why", ontoggle: () => { opened = why.open; if (opened) align(); } }, make("summary", {}, "Alignment ", make("kbd", {}, "a")));
    let move = () => {}, drawn = false;
    async function align() {
      if (drawn) return;
      drawn = true;
      const record = await gesture.detail(row);
      if (!wanted() || !record) return why.append(make("p", { class: "dim" }, data.unaligned || "Nothing was aligned for this row."));
      const picture = gesture.alignment.show(row, record, wanted);
      why.append(picture.element);
      move = picture.move;
    }
    const facts = make("dl", { class: "facts" });
    const fact = (name, value) => value && facts.append(make("div", {}, make("dt", {}, name), make("dd", {}, value)));
    fact(sureness, row[sureness] === null ? "" : number(row[sureness]));
    if (sureness === "confidence") fact("margin", row.margin === null ? "" : number(row.margin));
    if (sureness !== "score") fact("score", row.score === null ? "" : number(row.score));
    fact("distance", row.distance === null ? "" : distance(row.distance));
    fact("time", row.start === null ? "" : `${number(row.start, 2)} to ${number(row.end, 2)} s`);
    fact("person", row.person ? String(row.person) : "");
    const verdict = row.right === null ? null : make("span", { class: row.right ? "right" : "wrong" }, row.right ? "✓ right" : `✗ performed: ${row.truth}`);
    shown = why;
    place.replaceChildren(
      make("div", { class: "stage-head" },
        make("div", {}, make("h2", { class: row.label === null ? "unlabelled" : null }, row.label ?? "no label", " ", verdict), make("p", { class: "dim path", title: row.input }, row.name)),
        make("div", { class: "steps" },
          make("button", { type: "button", onclick: () => step(-1), "aria-label": "Previous row" }, "↑"),
          make("button", { type: "button", onclick: () => step(1), "aria-label": "Next row" }, "↓"),
          make("button", { type: "button", class: "close", onclick: close, "aria-label": "Close" }, "✕"))),
      panels,
      pictured ? make("div", { class: "controls" }, button, slider, clock, pace) : "",
      gesture.review?.panel(row) ?? "",
      row.message ? make("p", { class: `message ${row.status}` }, row.message) : "",
      facts, row.note ? make("p", { class: "dim small" }, row.note) : "", why);
    const linear = (one) => (at) => (at / (row.seconds || 1)) * one.seconds;
    const players = sides.map(([, one], index) => ({ video: screens[index], time: linear(one) })).filter(({ video }) => video instanceof HTMLVideoElement);
    gesture.player.play(query, players, row.seconds, (at) => {
      if (document.activeElement !== slider) slider.value = (1000 * at) / (row.seconds || 1);
      clock.textContent = `${number(at, 1)} of ${number(row.seconds, 1)} s`;
      slider.setAttribute("aria-valuetext", clock.textContent);
      move(at);
    });
    gesture.detail(row).then((record) => {
      if (!wanted() || !record) return;
      sides.forEach(([kind], index) => {
        const side = record[kind];
        if (!side) return;
        screens[index].classList.toggle("mirrored", side.mirrored);
        screens[index].parentElement.querySelector(".away").textContent = `distance ${distance(side.distance)}${side.mirrored ? ", mirrored" : ""}`;
        const one = players.find(({ video }) => video === screens[index]);
        if (one) one.time = (at) => gesture.player.warp(record.time, side.time, 1000 * at) / 1000;
      });
    });
    if (opened) why.open = true;
  }

  function step(by) {
    const at = state.shown.indexOf(state.chosen);
    const next = state.shown[Math.max(0, Math.min(state.shown.length - 1, at < 0 ? 0 : at + by))];
    if (!next) return;
    choose(next);
    gesture.list.reveal(next);
    gesture.list.mark();
  }

  function close() {
    document.body.classList.remove("staged");
    gesture.list.focus();
  }

  gesture.listeners.add(() => {
    if (state.shown.includes(state.chosen)) return;
    choose(state.shown.find((row) => !data.review || !state.answers.has(row.index)) ?? state.shown[0] ?? null);
  });
  return { choose, step, close, render: () => render(state.chosen), toggle: () => { if (shown) shown.open = !shown.open; } };
})();
