// Answers of a person, kept beside the machine's: one key a clip, and the next one plays.
"use strict";
gesture.review = (() => {
  const { data, rows, state, make, counted } = gesture;
  if (!data.review) return null;
  const KEYS = "123456789qwertyuiopsdfghlzxcvbnm";
  const labels = [], history = [];
  for (const label of data.labels) learn(label);
  for (const [index, label] of data.review.answers) {
    state.answers.set(index, label);
    if (label !== null) learn(label);
  }

  // A label gets a key once; those that a person typed follow those of the examples.
  function learn(label) {
    if (!labels.some((one) => one.label === label)) labels.push({ label, key: KEYS[labels.length] ?? "" });
  }

  // What was answered: a label, or null for none of these.
  function said(row) {
    if (!state.answers.has(row.index)) return "";
    const label = state.answers.get(row.index);
    if (label === null) return "none of these";
    return label === row.label ? "confirmed" : `answer: ${label}`;
  }

  async function send(row, answer) {
    const reply = await fetch("answers", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ row: row.index, ...answer }) });
    if (!reply.ok) throw new Error(await reply.text());
  }

  async function give(row, label) {
    if (!row) return;
    if (label !== null) learn(label);
    const before = state.answers.has(row.index) ? { label: state.answers.get(row.index) } : null;
    state.answers.set(row.index, label);
    history.push({ row, before });
    const at = state.shown.indexOf(row);
    const next = [...state.shown.slice(at + 1), ...state.shown.slice(0, at)].find((one) => !state.answers.has(one.index));
    gesture.list.redraw();
    if (next) { gesture.stage.choose(next); gesture.list.reveal(next); gesture.list.mark(); } else gesture.stage.render();
    try {
      await send(row, { label });
    } catch (error) {
      if (before) state.answers.set(row.index, before.label); else state.answers.delete(row.index);
      alert(`The answer about ${row.name} was not kept: ${error.message}`);
      gesture.list.redraw();
    }
  }

  async function undo() {
    const last = history.pop();
    if (!last) return;
    const { row, before } = last;
    if (before) state.answers.set(row.index, before.label); else state.answers.delete(row.index);
    gesture.stage.choose(row, { scroll: true });
    gesture.list.redraw();
    await send(row, before ?? { forget: true }).catch((error) => alert(`Nothing was undone: ${error.message}`));
  }

  function panel(row) {
    const button = (key, words, label, kind) => {
      const given = state.answers.has(row.index) && state.answers.get(row.index) === label;
      return make("button", { type: "button", class: `answer-button ${kind}`, "aria-pressed": given, onclick: () => give(row, label) }, make("kbd", {}, key), ` ${words}`);
    };
    const typed = make("input", { type: "text", placeholder: "another label", "aria-label": "Another label", maxlength: 60, autocomplete: "off", spellcheck: "false" });
    const another = make("form", { class: "another", onsubmit: (event) => { event.preventDefault(); const label = typed.value.trim().replace(/\s+/g, " "); if (label) give(row, label); } }, make("kbd", {}, "+"), " ", typed);
    const rival = row.far === null ? null : gesture.examples[row.far].label;
    return make("section", { class: "review", "aria-label": "Your answer" },
      make("p", { class: "review-head" }, make("b", {}, "What is it?"), make("span", { class: "dim", role: "status" }, `${counted(state.answers.size, "answer")} of ${counted(rows.length, "row")}`)),
      make("div", { class: "answers" },
        row.best === null ? null : button("↵", row.label === null ? `it is ${row.best}` : `yes, ${row.label}`, row.best, "confirm"),
        button("0", "none of these", null, "reject"),
        make("button", { type: "button", class: "answer-button undo", onclick: undo, disabled: history.length === 0 }, make("kbd", {}, "⌫"), " undo")),
      make("div", { class: "answers" }, ...labels.map(({ label, key }) => button(key, label, label, label === rival ? "rival" : "")), another));
  }

  function key(event) {
    const row = state.chosen;
    if (!row) return false;
    if (event.key === "Enter" && row.best !== null) give(row, row.best);
    else if (event.key === "0") give(row, null);
    else if (event.key === "Backspace") undo();
    else if (event.key === "+") document.querySelector("#stage .another input")?.focus();
    else {
      const found = labels.find((one) => one.key === event.key.toLowerCase());
      if (!found) return false;
      give(row, found.label);
    }
    return true;
  }

  // Of now: a label that a person typed has a key, too; the last ones of many have none.
  function keys() {
    const own = labels.filter((one) => one.key).map((one) => [one.key, one.label]);
    return [["Enter", "the label is right"], ["0", "none of these"], ["+", "another label: type it, then Enter"], ["Backspace", "undo"], ...own];
  }

  return { said, panel, key, keys };
})();
