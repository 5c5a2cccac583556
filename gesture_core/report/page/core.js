// The run's data, what is shown of it, and how elements are made: text is never read as markup.
"use strict";
window.gesture = (() => {
  const data = window.gestureData;
  const at = Object.fromEntries(data.columns.map((name, index) => [name, index]));
  const examples = data.examples.map(([name, label, clip, seconds]) => ({ name, label, clip, seconds }));
  const rows = data.rows.map((values, index) => {
    const row = { index };
    for (const name of data.columns) row[name] = values[at[name]];
    row.best = row.label ?? (row.near === null ? null : examples[row.near].label);
    row.right = row.truth === null ? null : (row.label ?? "_none") === row.truth;
    return row;
  });
  // Stands for "no label" among labels: no label can hold it.
  const NOTHING = "\0";
  const base = sharedFolder(rows.map((row) => row.input));
  for (const row of rows) {
    row.name = row.input.slice(base.length);
    const path = row.input.includes("://") ? row.name.split("::")[0] : row.name; // of a file in an archive
    const cut = path.lastIndexOf("/") + 1;
    [row.folder, row.file] = [row.name.slice(0, cut), path.slice(cut)];
    row.words = `${row.name} ${row.label ?? ""} ${row.truth ?? ""} ${row.status} ${row.code} ${row.message} ${row.note}`.toLowerCase();
  }

  // The folder that all names lie in, with a slash at its end.
  function sharedFolder(names) {
    if (names.length === 0) return "";
    const sorted = [...names].sort();
    const [first, last] = [sorted[0], sorted[sorted.length - 1]];
    let same = 0;
    while (same < first.length && first[same] === last[same]) same++;
    return first.slice(0, first.lastIndexOf("/", same === first.length ? same : same - 1) + 1);
  }

  // An element; children are elements or text.
  function make(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    return dress(element, attributes, children);
  }

  function draw(tag, attributes = {}, ...children) {
    return dress(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
  }

  function dress(element, attributes, children) {
    for (const [name, value] of Object.entries(attributes)) {
      if (value === null || value === undefined || value === false) continue;
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (name === "style") for (const [property, one] of Object.entries(value)) element.style.setProperty(property, one);
      else element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
    return element;
  }

  // A preview without sound; its still stands there until it plays.
  function film(clip, attributes) {
    const video = make("video", { muted: true, playsinline: true, poster: `clips/${clip.replace(/mp4$/, "jpg")}`, "aria-hidden": "true", tabindex: "-1", ...attributes });
    video.muted = true;
    return video;
  }

  const number = (value, digits = 3) => (value === null || value === undefined ? "–" : Number(value).toFixed(digits));
  // A distance may be of any size.
  const distance = (value) => number(value, value >= 100 ? 0 : value >= 10 ? 1 : 3);
  const percent = (share) => `${(100 * share).toFixed(share === 1 ? 0 : 1)} %`;
  const counted = (count, noun) => `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;

  // The 95 % interval of a share of independent trials (Wilson 1927).
  function wilson(right, all) {
    if (all === 0) return [0, 1];
    const z = 1.959964, share = right / all, room = (z * z) / all;
    const middle = (share + room / 2) / (1 + room);
    const reach = (z * Math.sqrt((share * (1 - share)) / all + (room / all) / 4)) / (1 + room);
    return [Math.max(0, middle - reach), Math.min(1, middle + reach)];
  }

  // Whether anything has a picture: of channels there is none, and a page may be made without.
  const pictured = rows.some((row) => row.clip) || examples.some((one) => one.clip);
  // How certain a row is: the score of an event, a calibrated confidence, or else the margin.
  const sureness = data.sureness;
  const orders = {
    sure: { text: "least certain first", by: (row) => row[sureness] ?? Infinity, sign: 1 },
    unsure: { text: "most certain first", by: (row) => row[sureness] ?? -Infinity, sign: -1 },
    name: { text: "by name", by: (row) => row.index, sign: 1 },
    label: { text: "by label", by: (row) => row.label ?? "\uffff", sign: 1 },
    distance: { text: "farthest first", by: (row) => row.distance ?? -Infinity, sign: -1 },
  };

  const state = {
    text: "", label: "", status: "", sure: "", answer: "", person: "", folder: "", truth: null, order: "sure",
    threshold: { by: "sure", value: null }, answers: new Map(),
    shown: [], chosen: null,
  };
  const listeners = new Set();

  // What the run itself refuses beyond, or below; null where it refuses nothing of the kind.
  const limits = { distance: data.reject, sure: sureness === "score" ? null : data[sureness] };
  // Whether a row keeps its label where the threshold that is being tried stands in the place of the run's.
  function keeps(row, threshold = state.threshold) {
    if (row.best === null) return false;
    if (threshold.value === null) return row.label !== null;
    if (threshold.by === "distance") {
      if (data.min_score !== null && row.score !== null && row.score < data.min_score) return false;
      return row.code !== "E_UNSURE" && row.distance !== null && row.distance <= threshold.value;
    }
    if (sureness === "confidence" && data.margin !== null && row.margin !== null && row.margin < data.margin) return false;
    return row.code !== "E_REJECTED" && (row[sureness] === null || row[sureness] >= threshold.value);
  }

  function fits(row) {
    const { text, label, status, sure, answer, person, folder, truth } = state;
    if (label !== "" && (row.label ?? NOTHING) !== label) return false;
    if (truth !== null && row.truth !== truth) return false;
    if (status === "wrong" ? row.right !== false : status !== "" && row.status !== status) return false;
    if (sure !== "" && keeps(row) !== (sure === "above")) return false;
    if (answer !== "" && state.answers.has(row.index) !== (answer === "given")) return false;
    if (person !== "" && String(row.person) !== person) return false;
    if (folder !== "" && row.folder !== folder) return false;
    return text === "" || text.toLowerCase().split(/\s+/).every((word) => row.words.includes(word));
  }

  // Filter and sort again, and tell everybody.
  function show(changes = {}) {
    Object.assign(state, changes);
    const { by, sign } = orders[state.order];
    state.shown = rows.filter(fits).sort((a, b) => {
      const [one, other] = [by(a), by(b)];
      return (one < other ? -sign : one > other ? sign : 0) || a.index - b.index;
    });
    for (const listener of listeners) listener();
  }

  // Alignments lie in files of some rows each, which are loaded when one of them is looked at.
  const details = new Map(), loading = new Map(), done = new Map();
  function loaded(chunk, records) {
    records.forEach((record, place) => details.set(chunk * data.chunk + place, record));
    done.get(chunk)?.();
  }
  async function detail(row) {
    const chunk = Math.floor(row.index / data.chunk);
    if (!data.details.includes(chunk)) return null;
    if (!loading.has(chunk)) {
      loading.set(chunk, new Promise((resolve) => {
        done.set(chunk, resolve);
        document.head.append(make("script", { src: `details/${chunk}.js`, onerror: resolve }));
      }));
    }
    await loading.get(chunk);
    return details.get(row.index) ?? null;
  }

  return {
    data, rows, examples, state, orders, sureness, limits, pictured, keeps, show, listeners, detail, details: loaded,
    make, draw, film, number, distance, percent, counted, wilson, base, NOTHING,
  };
})();
