"use strict";
// Draws the page's charts from the data beside it, in the reader's colours; sorts the table; shows the picked candidate.
(() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const family = getComputedStyle(document.body).fontFamily;
  const narrow = matchMedia("(max-width: 640px)");
  const state = { shown: page.best, printing: false };
  const drawn = new Set();
  const places = new Map([...document.querySelectorAll(".plot")].map((el) => [el.dataset.figure, el]));
  window.softclose = { drawn, places, state };

  // "@role" or "@role/opacity" anywhere in a chart stands for a colour of the current theme.
  function themed(value) {
    if (typeof value === "string" && value.startsWith("@")) {
      const [role, opacity] = value.slice(1).split("/");
      const hex = page.palettes[dark.matches && !state.printing ? "dark" : "light"][role];
      if (opacity === undefined) return hex;
      const [r, g, b] = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
      return `rgba(${r},${g},${b},${opacity})`;
    }
    if (Array.isArray(value)) return value.map(themed);
    if (value && Object.getPrototypeOf(value) === Object.prototype)
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, themed(v)]));
    return value;
  }

  function unpack(packed) {
    const raw = atob(packed.codes);
    const out = new Float64Array(raw.length / 2);
    for (let i = 0; i < out.length; i++) {
      const code = raw.charCodeAt(2 * i) | (raw.charCodeAt(2 * i + 1) << 8);
      out[i] = code === 65535 ? NaN : packed.low + code * packed.step;
    }
    return out;
  }

  // All motions of one panel as a single line, with a gap after each switch: one SVG path is quick, hundreds are not.
  function strung(traces, which, rows) {
    const n = traces.times.length;
    const values = unpack(traces[which]);
    const x = new Array(rows.length * (n + 1));
    const y = new Array(rows.length * (n + 1));
    let k = 0;
    for (const s of rows) {
      for (let i = 0; i < n; i++, k++) { x[k] = traces.times[i]; y[k] = values[s * n + i]; }
      x[k] = traces.times[n - 1]; y[k++] = null;
    }
    return { x, y };
  }

  // u(t) of rows of start, rise, flat top (null: holds) and volts: exact at every knot, 24 points on each ramp.
  function drive(rows) {
    const instants = new Set([0, page.horizon]);
    for (const [start, rise, top] of rows) {
      for (const from of top === null ? [start] : [start, start + rise + top]) {
        for (let k = 0; k < 24; k++) instants.add(from + (rise * k) / 23);
        if (!rise) instants.add(from - 1e-9); // an ideal step is drawn upright
      }
    }
    const risen = (t, rise) => (t < 0 ? 0 : t >= rise ? 1 : 0.5 * (1 - Math.cos((Math.PI * t) / rise)));
    const x = [...instants].filter((t) => t >= -1e-9 && t <= page.horizon).sort((a, b) => a - b);
    const y = x.map((t) => rows.reduce((u, [start, rise, top, volts]) => u + volts *
      (risen(t - start, rise) - (top === null ? 0 : risen(t - start - rise - top, rise))), 0));
    return { x, y };
  }

  function responseFigure(pick) {
    const figure = structuredClone(page.figures.response);
    const [voltage, distance, velocity, openDistance, openVelocity, impacts] = figure.data;
    Object.assign(voltage, drive(pick.rows));
    if (pick.traces) {
      const open = new Set(pick.traces.open);
      const closes = Array.from({ length: pick.traces.n }, (_, s) => s).filter((s) => !open.has(s));
      Object.assign(distance, strung(pick.traces, "x", closes));
      Object.assign(velocity, strung(pick.traces, "v", closes));
      Object.assign(openDistance, strung(pick.traces, "x", pick.traces.open));
      Object.assign(openVelocity, strung(pick.traces, "v", pick.traces.open));
      distance.opacity = velocity.opacity = pick.traces.n > 60 ? 0.55 : 0.85;
      impacts.x = pick.traces.impacts.map((p) => p[0]);
      impacts.y = pick.traces.impacts.map((p) => p[1]);
    }
    return figure;
  }

  function histogramFigure(pick) {
    const figure = structuredClone(page.figures.histogram);
    if (!pick.shares) {
      figure.layout.annotations = [{ xref: "paper", yref: "paper", x: 0.5, y: 0.5, showarrow: false, font: { color: "@muted" },
        text: "The speeds of this candidate’s switches are in the store, not on this page." }];
      return figure;
    }
    figure.data[0].y = pick.shares;
    const last = pick.shares.reduce((m, s, i) => (s > 0 ? i : m), 0);
    figure.layout.xaxis.range = [0, Math.max(10, Math.ceil((last + 2) / 5) * 5)];
    const marks = [["mean", pick.mean, "dot", "right"], ["v<sub>u</sub>", pick.v_u, "dash", "left"]]
      .filter((m) => m[1] !== null);
    figure.layout.shapes = marks.map(([, at, dash]) => ({ type: "line", x0: at, x1: at, yref: "paper", y0: 0, y1: 1,
      line: { color: "@deterministic", width: 2, dash } }));
    figure.layout.annotations = marks.map(([name, at, , anchor]) => ({ x: at, xanchor: anchor, yref: "paper", y: 1,
      yanchor: "bottom", showarrow: false, text: `${name} ${at.toFixed(1)} cm/s`, font: { color: "@deterministic" } }));
    return figure;
  }

  function figureOf(name) {
    const pick = page.picks && page.picks[state.shown];
    if (name === "response" && pick) return responseFigure(pick);
    if (name === "histogram" && pick) return histogramFigure(pick);
    if (name === "pair-0") { // one place, many maps
      const choice = document.getElementById("pair");
      return page.figures[choice ? choice.value : name];
    }
    return page.figures[name];
  }

  function draw(name) {
    const el = places.get(name);
    const { data, layout } = themed(figureOf(name));
    layout.font = { ...layout.font, family };
    layout.width = el.clientWidth || 340;
    if (state.printing && name === "response") layout.height = 560;
    if (state.printing && el.clientWidth < 360) {
      layout.font.size = 11;
      layout.xaxis.title.font = { size: 10 };
    }
    if (narrow.matches && !state.printing) {
      layout.dragmode = false; // a finger scrolls the page
      layout.margin = { ...layout.margin, l: Math.min(layout.margin.l, 48), r: 8 };
      layout.font.size = 12;
    }
    el.style.height = `${layout.height}px`;
    Plotly.react(el, data, layout, {
      // plotly.js offers to upload a chart to its makers' cloud unless told not to: this is somebody's design.
      showSendToCloud: false, plotlyServerURL: "",
      displaylogo: false, responsive: false, displayModeBar: state.printing || narrow.matches ? false : "hover",
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { format: "svg", filename: `softclose-${name}` },
    });
    const tools = () => [...el.querySelectorAll(".modebar button")];
    tools().forEach((tool) => { tool.tabIndex = -1; });
    if (!drawn.has(name)) {
      drawn.add(name);
      // A plot is one stop of the Tab key; the arrows walk through its tools, Escape leaves them.
      el.addEventListener("keydown", (e) => {
        const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key], all = tools(), at = all.indexOf(document.activeElement);
        if (e.key === "Escape") return el.focus();
        if (!by || !all.length) return;
        e.preventDefault();
        all[at < 0 ? (by > 0 ? 0 : all.length - 1) : (at + by + all.length) % all.length].focus();
      });
      if (name === "convergence") el.on("plotly_click", (e) => show(e.points[0].x, true));
      if (name === "front") el.on("plotly_click", (e) => show(e.points[0].customdata?.[0] ?? e.points[0].customdata, true));
    }
  }

  // What is folded away has no width until it is opened.
  document.querySelectorAll("details").forEach((fold) => fold.addEventListener("toggle", () => {
    if (fold.open) fold.querySelectorAll(".plot").forEach((el) => draw(el.dataset.figure));
  }));

  const drawAll = () => places.forEach((_, name) => draw(name));

  // What can be seen first; the rest whenever the browser has time, so that printing and searching find it.
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting && !drawn.has(entry.target.dataset.figure)) {
      draw(entry.target.dataset.figure);
      near.unobserve(entry.target);
    }
  }, { rootMargin: "300px" });
  places.forEach((el) => near.observe(el));
  const later = window.requestIdleCallback || ((f) => setTimeout(f, 30));
  (function rest() {
    const next = [...places.keys()].find((name) => !drawn.has(name));
    if (next === undefined) return document.documentElement.setAttribute("data-ready", "");
    later(() => { if (!drawn.has(next)) draw(next); rest(); });
  })();

  dark.addEventListener("change", drawAll);
  let width = innerWidth, timer = 0;
  addEventListener("resize", () => {
    if (state.printing || innerWidth === width) return;
    width = innerWidth;
    clearTimeout(timer);
    timer = setTimeout(drawAll, 120);
  });
  const wasOpen = new Map();
  function onPaper(printing) {
    state.printing = printing;
    document.body.classList.toggle("onpaper", printing);
    document.querySelectorAll("details").forEach((el) => {
      if (printing) wasOpen.set(el, el.open);
      el.open = printing || wasOpen.get(el);
    });
    drawAll();
  }
  addEventListener("beforeprint", () => onPaper(true));
  addEventListener("afterprint", () => onPaper(false));

  function fill(body, rows) {
    body.replaceChildren(...rows.map((cells) => {
      const tr = document.createElement("tr");
      cells.forEach((text, i) => {
        const cell = document.createElement(i ? "td" : "th");
        if (i) cell.className = i === 2 && cells.length === 3 ? "n interval" : "n"; else cell.scope = "row";
        cell.textContent = text;
        tr.append(cell);
      });
      return tr;
    }));
  }

  function show(i, scroll) {
    const pick = page.picks[i];
    const told = document.getElementById("pick-said");
    if (!pick) {
      if (told) told.textContent = `candidate ${i} failed, or this page does not hold it; the table below says which`;
      return;
    }
    state.shown = i;
    document.getElementById("pick").value = String(i);
    const place = document.getElementById("place");
    if (place) place.value = [...place.options].some((o) => o.value === String(i)) ? String(i) : "";
    told.textContent = `${String(i) === String(page.best) ? "the best candidate" : `candidate ${i}`}, proposed by: ${pick.origin}` +
      (pick.traces ? `; ${pick.traces.n} of its switches are drawn` : "; its switches’ motion is in the store, not on this page");
    fill(document.getElementById("pulses"), pick.pulses.map((p, k) => [String(k + 1), ...p]));
    fill(document.getElementById("metrics"), page.metrics.map((name, k) => [name, ...pick.values[k]]));
    document.querySelectorAll("#table tr.shown").forEach((tr) => tr.classList.remove("shown"));
    document.querySelector(`#table tr[data-candidate="${Number(i)}"]`)?.classList.add("shown");
    for (const name of ["response", "histogram"]) if (drawn.has(name)) draw(name);
    if (scroll) document.getElementById("design").scrollIntoView();
  }

  const pick = document.getElementById("pick");
  if (pick) {
    const held = Object.keys(page.picks).map(Number).sort((a, b) => a - b);
    const step = (by) => {
      const at = held.indexOf(Number(state.shown)) + by;
      if (at >= 0 && at < held.length) show(held[at], false);
    };
    pick.addEventListener("change", () => show(Number(pick.value), false));
    document.getElementById("place")?.addEventListener("change", (e) => e.target.value && show(Number(e.target.value), false));
    document.getElementById("pick-previous").addEventListener("click", () => step(-1));
    document.getElementById("pick-next").addEventListener("click", () => step(1));
    document.getElementById("pick-best").addEventListener("click", () => show(page.best, false));
    show(page.best, false);
  }
  document.getElementById("pair")?.addEventListener("change", () => draw("pair-0"));

  const table = document.getElementById("table");
  table?.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    if (button.dataset.show !== undefined) return show(Number(button.dataset.show), true);
    const column = Number(button.dataset.column);
    const head = button.closest("th");
    const down = head.getAttribute("aria-sort") === "ascending";
    table.querySelectorAll("thead th").forEach((th) => th.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const body = table.tBodies[0];
    const key = (tr) => tr.cells[column].dataset.sort;
    const numeric = head.classList.contains("n");
    const order = (a, b) => (numeric ? Number(a) - Number(b) : a.localeCompare(b)) * (down ? -1 : 1);
    // Rows without a value stay last either way.
    body.append(...[...body.rows].sort((a, b) => (key(a) === "") - (key(b) === "") || order(key(a), key(b))));
  });

  // Rows that hold the words, and leave no more open than asked for.
  const filter = document.getElementById("filter"), mostOpen = document.getElementById("most-open");
  function narrowDown() {
    const words = filter.value.trim().toLowerCase(), most = mostOpen.value === "" ? Infinity : Number(mostOpen.value) / 100;
    let n = 0;
    for (const tr of table.tBodies[0].rows) {
      const said = `${tr.dataset.candidate} ${[...tr.cells].slice(-2).map((c) => `${c.textContent} ${c.title}`).join(" ")}`.toLowerCase();
      const open = tr.querySelector("[data-open]")?.dataset.sort;
      tr.hidden = !said.includes(words) || (most < Infinity && (open === "" || Number(open) > most));
      n += !tr.hidden;
    }
    document.getElementById("filtered").textContent = `${n} of ${table.tBodies[0].rows.length} rows`;
  }
  for (const input of [filter, mostOpen]) input?.addEventListener("input", narrowDown);
})();
