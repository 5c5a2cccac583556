// Headings, filters and keys; then the first rows are drawn.
"use strict";
(() => {
  const { data, rows, state, orders, sureness, show, make, counted } = gesture;
  const field = (name) => document.getElementById(`f-${name}`);
  const options = (select, list) => select.append(...list.map(([value, words]) => make("option", { value }, words)));
  const values = (name) => [...new Set(rows.map((row) => row[name]))].filter((one) => one !== null).sort((a, b) => (a < b ? -1 : 1));

  document.title = `${data.review ? "Review" : "Report"}: ${data.run}`;
  document.getElementById("title").textContent = data.run;
  document.getElementById("facts").textContent = [
    counted(rows.length, "row"), data.labels.length ? counted(data.labels.length, "label") : "", data.examples.length ? counted(data.examples.length, "example") : "",
    data.preset ? `preset ${data.preset}` : "", data.reject === null || data.kind !== "labels" ? "" : `no label beyond distance ${data.reject}`, data.margin === null || data.kind !== "labels" ? "" : `no label below margin ${data.margin}`,
    data.min_score === null || data.kind !== "labels" ? "" : `no label below score ${data.min_score}`,
    !data.confidence || data.kind !== "labels" ? "" : `no label below confidence ${data.confidence}`,
  ].filter(Boolean).join(" · ");
  document.getElementById("foot").textContent = `gesture-core ${data.version} · run ${data.fingerprint}${gesture.base ? ` · inputs in ${gesture.base}` : ""}`;
  document.getElementById("h-sure").textContent = sureness[0].toUpperCase() + sureness.slice(1);
  document.body.classList.toggle("unpictured", !gesture.pictured);

  options(field("label"), [["", "all"], ...[...new Set([...data.labels, ...values("label")])].sort().map((one) => [one, one]), ...(rows.some((row) => row.label === null) ? [[gesture.NOTHING, "no label"]] : [])]);
  options(field("status"), [["", "all"], ...values("status").map((one) => [one, one]), ...(rows.some((row) => row.right === false) ? [["wrong", "wrong label"]] : [])]);
  options(field("sure"), [["", "all"], ["above", "keeps its label"], ["below", "loses its label"]]);
  options(field("answer"), [["", "all"], ["open", "not answered"], ["given", "answered"]]);
  options(field("person"), [["", "all"], ...values("person").map((one) => [String(one), String(one)])]);
  options(field("folder"), [["", "all"], ...values("folder").map((one) => [one, one || "(top)"])]);
  options(field("order"), Object.entries(orders).map(([value, one]) => [value, one.text]));
  document.getElementById("l-person").hidden = values("person").length < 2;
  document.getElementById("l-folder").hidden = values("folder").length < 2;
  document.getElementById("l-sure").hidden = data.kind === "keypoints";
  document.getElementById("l-answer").hidden = !data.review;

  const opener = document.getElementById("filter-open");
  opener.addEventListener("click", () => opener.setAttribute("aria-expanded", document.getElementById("filters").classList.toggle("open")));
  let typing = 0;
  const filters = ["label", "status", "sure", "answer", "person", "folder", "order"];
  for (const name of filters) field(name).addEventListener("change", () => show({ [name]: field(name).value, ...(name === "label" ? { truth: null } : {}) }));
  field("text").addEventListener("input", () => { clearTimeout(typing); typing = setTimeout(() => show({ text: field("text").value.trim() }), 60); });
  document.getElementById("filters").addEventListener("submit", (event) => event.preventDefault());
  document.getElementById("clear").addEventListener("click", () => { field("text").value = ""; show({ text: "", label: "", status: "", sure: "", answer: "", person: "", folder: "", truth: null }); });
  for (const head of document.querySelectorAll("th[data-order]")) {
    head.firstChild.addEventListener("click", () => show({ order: head.dataset.order === "sure" && state.order === "sure" ? "unsure" : head.dataset.order }));
  }
  gesture.listeners.add(() => {
    for (const name of filters) field(name).value = state[name];
    const some = ["text", "label", "status", "sure", "answer", "person", "folder"].some((name) => state[name] !== "") || state.truth !== null;
    document.getElementById("clear").hidden = !some;
    document.getElementById("count").textContent = some ? `${state.shown.length.toLocaleString("en")} of ${counted(rows.length, "row")}${state.truth === null ? "" : `, performed: ${state.truth}`}` : counted(rows.length, "row");
    for (const head of document.querySelectorAll("th[data-order]")) {
      const here = head.dataset.order === state.order || (head.dataset.order === "sure" && state.order === "unsure");
      if (here) head.setAttribute("aria-sort", orders[state.order].sign > 0 ? "ascending" : "descending"); else head.removeAttribute("aria-sort");
    }
  });

  const help = document.getElementById("help");
  const keys = [["↓ j", "next row"], ["↑ k", "previous row"], ["Space", "play or pause"], ["a", "alignment"], ["/", "search"], ["Home End", "first, last row"], ["Esc", "close, show all"], ["?", "this list"]];
  function open() {
    const every = [...keys, ...(gesture.review?.keys() ?? [])];
    document.getElementById("keys").replaceChildren(...every.map(([key, words]) => make("div", {}, make("dt", {}, make("kbd", {}, key)), make("dd", {}, words))));
    help.showModal();
  }
  document.getElementById("help-open").addEventListener("click", open);

  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open) return;
    const typed = event.target.closest("input, select");
    if (event.key === "Escape") {
      if (event.target.matches("#stage input[type=text]")) event.target.value = "";
      else if (document.body.classList.contains("staged")) gesture.stage.close();
      else document.getElementById("clear").click();
      event.target.blur();
      return;
    }
    if (typed) return;
    const pressed = event.target.closest("button, summary, a") && (event.key === " " || event.key === "Enter");
    if (pressed) return;
    const act = {
      ArrowDown: () => gesture.stage.step(1), ArrowUp: () => gesture.stage.step(-1), " ": () => document.querySelector(".play")?.click(),
      Home: () => gesture.stage.choose(state.shown[0] ?? null, { scroll: true }), End: () => gesture.stage.choose(state.shown[state.shown.length - 1] ?? null, { scroll: true }),
      "/": () => field("text").focus(), "?": open, j: () => gesture.stage.step(1), k: () => gesture.stage.step(-1), a: () => gesture.stage.toggle(),
    }[event.key];
    if (act) act();
    else if (!gesture.review?.key(event)) return;
    event.preventDefault();
  });

  show();
  if (data.review && state.chosen) gesture.list.reveal(state.chosen); // where the last session ended
})();
