"use strict";
// Shows what the server says of its folder: one card a campaign, drawn again when it changes.
(() => {
  const place = document.getElementById("campaigns");
  const said = document.getElementById("said");
  const SVG = "http://www.w3.org/2000/svg";

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
  }

  function drawn(tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    return made;
  }

  function duration(seconds) {
    if (seconds < 90) return `${Math.max(1, Math.round(seconds))} s`;
    return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
  }

  // The best so far as a staircase; a larger ensemble begins where the dotted line is.
  function history(campaign) {
    const [at, g] = campaign.history;
    const [width, height, left, bottom] = [640, 150, 44, 24];
    const top = Math.max(...g), low = Math.min(...g), span = top - low || 1;
    const x = (i) => left + ((width - left - 8) * i) / Math.max(campaign.budget, 1);
    const y = (v) => 10 + ((height - bottom - 14) * (top - v)) / span;
    const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "history",
      "aria-label": `Best g so far, from ${g[0].toFixed(1)} to ${g[g.length - 1].toFixed(1)} cm/s` });
    let path = `M${x(at[0])},${y(g[0])}`;
    for (let k = 1; k < at.length; k++) path += `H${x(at[k])}V${y(g[k])}`;
    path += `H${x(campaign.committed)}`;
    for (const [i] of campaign.larger) svg.append(drawn("line", { x1: x(i), x2: x(i), y1: 4, y2: height - bottom, class: "larger" }));
    svg.append(drawn("line", { x1: left, x2: width - 8, y1: height - bottom, y2: height - bottom, class: "axis" }));
    svg.append(drawn("path", { d: path, class: "best" }));
    svg.append(drawn("text", { x: left - 6, y: y(top) + 4, class: "end" }, top.toFixed(1)));
    if (top > low) svg.append(drawn("text", { x: left - 6, y: y(low) + 4, class: "end" }, low.toFixed(1)));
    svg.append(drawn("text", { x: left, y: height - 6 }, "0"), drawn("text", { x: width - 8, y: height - 6, class: "end" }, `${campaign.budget} candidates`));
    return svg;
  }

  const percent = (share) => `${(100 * share).toFixed(2)} %`;
  const speed = (v) => (v === null ? "undefined" : `${v.toFixed(2)} cm/s`);
  const count = (n) => n.toLocaleString("en");
  const state = (campaign) => (campaign.problem ? "cannot be read" : campaign.committed === campaign.budget ? "finished" : campaign.driver ? "running" : "stopped");
  const left = (campaign) => (state(campaign) === "running" && campaign.left_s !== null ? `about ${duration(campaign.left_s)} left` : "");

  // What is known best of a campaign: its certificate where it has one, else the training scores of its best candidate.
  function figures(campaign) {
    const found = campaign.certified || campaign.best;
    if (!found) return null;
    const basis = campaign.certified ? `certified on ${count(found.n_switches)} new switches` :
      `not certified; optimistic, since tuned on these ${count(found.n_switches)} switches`;
    return { found, basis, open: `${percent(found.p_nc)} left open${campaign.certified ? "" : found.not_integrated}` };
  }

  function card(campaign) {
    const link = element("a", { href: campaign.report }, campaign.store);
    if (campaign.problem) return element("section", { class: "campaign", "data-store": campaign.store }, element("h2", {}, campaign.store), element("p", { class: "notice warn" }, campaign.problem));
    const words = [state(campaign), `${count(campaign.committed)} of ${count(campaign.budget)} candidates`];
    if (left(campaign)) words.push(left(campaign));
    if (campaign.failed) words.push(`${count(campaign.failed)} failed`);
    const bar = element("progress", { max: campaign.budget, value: campaign.committed, "aria-label": "Committed candidates" });
    const made = element("section", { class: "campaign", "data-store": campaign.store, "data-committed": campaign.committed },
      element("h2", {}, link), element("p", { class: "lead" }, campaign.name), bar, element("p", { class: "words" }, words.join(" · ")));
    const known = figures(campaign);
    if (known) {
      made.append(element("p", {}, element("strong", {}, `upper velocity ${speed(known.found.v_u_cm_s)}, ${known.open}`),
        ` (candidate ${known.found.candidate}, ${known.basis})`));
      if (known.found.warning) made.append(element("p", { class: "notice warn" }, known.found.warning));
    }
    if (campaign.best)
      made.append(history(campaign), element("p", { class: "small" }, "Training score g of the best candidate so far (cm/s)" + (campaign.larger.length ? "; a dotted line marks where a larger ensemble begins." : ".")));
    return made;
  }

  // More than a few campaigns are a table: those that run first, the others as people count.
  const FEW = 4;
  const filter = document.getElementById("filter");

  function row(campaign) {
    const known = figures(campaign);
    const cells = campaign.problem
      ? [element("td", { colspan: 5 }, campaign.problem)]
      : [
          element("td", { class: "n" }, `${count(campaign.committed)} of ${count(campaign.budget)}`),
          element("td", {}, left(campaign)),
          element("td", { class: "n" }, known ? speed(known.found.v_u_cm_s) : ""),
          element("td", { class: "n" }, known ? percent(known.found.p_nc) + (known.found.warning ? " !" : "") : ""),
          element("td", {}, known ? (campaign.certified ? `on ${count(known.found.n_switches)}` : "no") : ""),
        ];
    if (known && known.found.warning) cells[3].setAttribute("title", known.found.warning);
    return element("tr", { "data-store": campaign.store, "data-committed": campaign.committed, class: state(campaign).replace(/ /g, "-") },
      element("th", { scope: "row" }, campaign.problem ? campaign.store : element("a", { href: campaign.report }, campaign.store), element("span", { class: "interval" }, campaign.name)),
      element("td", {}, state(campaign)), ...cells);
  }

  function table(campaigns) {
    const heads = ["Campaign", "State", "Candidates", "Time left", "Upper velocity", "Left open", "Certified"];
    const body = element("tbody", {}, ...campaigns.map(row));
    return element("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "Campaigns" },
      element("table", { class: "plain campaigns" }, element("thead", {}, element("tr", {}, ...heads.map((h, i) => element("th", { scope: "col", ...(i === 2 || i === 4 || i === 5 ? { class: "n" } : {}) }, h)))), body));
  }

  let known = [];
  function show() {
    const wanted = filter.value.trim().toLowerCase();
    const order = [...known].sort((a, b) => (state(b) === "running") - (state(a) === "running")); // stable: else as listed
    const shown = order.filter((c) => `${c.store} ${c.name} ${state(c)}`.toLowerCase().includes(wanted));
    document.getElementById("filtering").hidden = known.length <= FEW;
    place.replaceChildren(...(known.length > FEW ? [table(shown)] : order.map(card)));
  }
  filter.addEventListener("input", show);

  const stream = new EventSource("events");
  stream.onmessage = (event) => {
    const campaigns = JSON.parse(event.data);
    said.textContent = campaigns.length ? `${campaigns.length} in this folder; this page follows them.` : "No campaign in this folder yet; this page waits for one.";
    known = campaigns;
    show();
    document.documentElement.dataset.ready = "";
  };
  stream.onerror = () => { said.textContent = "The server does not answer; what is shown may be old. Trying again …"; };
})();
