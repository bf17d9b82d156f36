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

  function card(campaign) {
    const link = element("a", { href: campaign.report }, campaign.store);
    if (campaign.problem) return element("section", { class: "campaign" }, element("h2", {}, campaign.store), element("p", { class: "notice warn" }, campaign.problem));
    const done = campaign.committed === campaign.budget;
    const words = [done ? "finished" : campaign.driver ? "running" : "not running", `${campaign.committed} of ${campaign.budget} candidates`];
    if (!done && campaign.driver && campaign.left_s !== null) words.push(`about ${duration(campaign.left_s)} left`);
    if (campaign.failed) words.push(`${campaign.failed} failed`);
    const bar = element("progress", { max: campaign.budget, value: campaign.committed, "aria-label": "Committed candidates" });
    const made = element("section", { class: "campaign", "data-store": campaign.store, "data-committed": campaign.committed },
      element("h2", {}, link), element("p", { class: "lead" }, campaign.name), bar, element("p", { class: "words" }, words.join(" · ")));
    const b = campaign.best;
    if (b) {
      const v = b.v_u_cm_s === null ? "undefined" : `${b.v_u_cm_s.toFixed(2)} cm/s`;
      made.append(element("p", {}, element("strong", {}, `best g ${b.g_cm_s.toFixed(2)} cm/s`),
        `, upper velocity ${v}, ${(100 * b.p_nc).toFixed(1)} % not closed${b.not_integrated} (candidate ${b.candidate}, not certified; optimistic, since tuned on these ${b.n_switches.toLocaleString("en")} switches)`));
      if (b.warning) made.append(element("p", { class: "notice warn" }, b.warning));
      made.append(history(campaign), element("p", { class: "small" }, "Best g so far (cm/s)" + (campaign.larger.length ? "; a dotted line where a larger ensemble begins." : ".")));
    }
    return made;
  }

  const stream = new EventSource("events");
  stream.onmessage = (event) => {
    const campaigns = JSON.parse(event.data);
    said.textContent = campaigns.length ? `${campaigns.length} in this folder; this page follows them.` : "No campaign in this folder yet; this page waits for one.";
    place.replaceChildren(...campaigns.map(card));
    document.documentElement.dataset.ready = "";
  };
  stream.onerror = () => { said.textContent = "The server does not answer; what is shown may be old. Trying again …"; };
})();
