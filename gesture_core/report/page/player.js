// Plays the query with both examples at its own time: the query runs, the examples are shown where it is.
"use strict";
gesture.player = (() => {
  const { make } = gesture;
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let query = null, sides = [], seconds = 1, listener = () => {}, frame = 0, paused = calm.matches, speed = 1;

  // A clip, or why there is none.
  function screen(clip, missing, mirrored = false) {
    if (!clip) return make("span", { class: "no-clip" }, missing || "no preview");
    return gesture.film(clip, { src: `clips/${clip}`, preload: "auto", class: mirrored ? "mirrored" : null });
  }

  // Milliseconds of an example at those of the query: between the places that are known, on straight lines.
  function warp(from, to, at) {
    if (at <= from[0]) return to[0];
    for (let i = 1; i < from.length; i++) {
      if (at <= from[i]) return to[i - 1] + ((at - from[i - 1]) / (from[i] - from[i - 1] || 1)) * (to[i] - to[i - 1]);
    }
    return to[to.length - 1];
  }

  // Begin to play; each side is a video and what turns seconds of the query into its own.
  function play(video, others, length, told) {
    stop();
    [query, sides, seconds, listener] = [video instanceof HTMLVideoElement ? video : null, others, length || 1, told];
    if (query) {
      query.loop = true;
      query.playbackRate = speed;
      if (!paused) query.play().catch(() => {});
    }
    begun = performance.now();
    frame = requestAnimationFrame(step);
  }

  let begun = 0, still = 0;
  function now() {
    if (query) return query.currentTime;
    return paused ? still : (((performance.now() - begun) / 1000) * speed) % seconds;
  }

  function step() {
    const at = now();
    for (const { video, time } of sides) {
      if (video.seeking || video.readyState < 1) continue;
      const wanted = Math.max(0, Math.min(time(at), (video.duration || 1e9) - 0.02));
      if (Math.abs(video.currentTime - wanted) > 0.03) video.currentTime = wanted;
    }
    listener(at);
    frame = requestAnimationFrame(step);
  }

  function stop() {
    cancelAnimationFrame(frame);
    query?.pause();
    [query, sides] = [null, []];
  }

  function pause(wanted = !paused) {
    still = now();
    paused = wanted;
    if (query && paused) query.pause();
    else query?.play().catch(() => {});
    begun = performance.now() - (still * 1000) / speed;
    return paused;
  }

  function seek(at) {
    pause(true);
    still = at;
    if (query) query.currentTime = at;
  }

  function pace(wanted) {
    speed = wanted;
    if (query) query.playbackRate = wanted;
  }

  return { screen, warp, play, stop, pause, seek, pace, get paused() { return paused; } };
})();
