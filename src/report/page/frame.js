// What every page has: numbers, colours, keys of charts, tables that sort, and figures (curves, points, heat maps) with pickers. Names come from data and are only ever shown as text.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const times = (t) => t.f64 === undefined
  ? Float64Array.from({ length: t.count }, (_, i) => t.from + i * t.step)
  : new Float64Array(bytes(t.f64).buffer);
const curve = (c) => {
  const codes = new Uint16Array(bytes(c.u16).buffer);
  const scale = (c.high - c.low) / 65534;
  return Array.from(codes, (code) => (code === 65535 ? null : c.low + code * scale));
};
// The usual distance between samples that are there; half of them missing or more is seldom.
const spacing = (x, y) => {
  const at = [];
  y.forEach((v, i) => { if (v !== null) at.push(x[i]); });
  const steps = at.slice(1).map((t, i) => t - at[i]).sort((a, b) => a - b);
  return { usual: steps.length ? steps[steps.length >> 1] : Infinity, seldom: at.length < y.length / 2 };
};
const minus = (a, b) => a.map((v, i) => (v === null || b[i] === null ? null : v - b[i]));
const make = (tag, parent, text) => {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (parent) parent.append(made);
  return made;
};
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const page = document.documentElement.dataset;
const wide = (box) => (page.print === undefined ? Math.max(box.clientWidth, 240) : 660);
const digits = (v) => {
  if (v === null || v === undefined || !Number.isFinite(v)) return "–";
  const size = Math.abs(v);
  return (size !== 0 && (size < 1e-4 || size >= 1e6) ? v.toExponential(3) : String(Number(v.toPrecision(5)))).replace("-", "−");
};
const tick = (v) => {
  const size = Math.abs(v);
  return (size !== 0 && (size < 1e-4 || size >= 1e6) ? v.toExponential(1) : String(Number(v.toPrecision(8)))).replace("-", "−");
};

const lined = () => ({ stroke: color("ink"), grid: { stroke: color("line"), width: 1 }, ticks: { stroke: color("line"), width: 1 } });
const press = (e, act) => { if (e.key === "Enter" || e.key === " ") { e.preventDefault(); e.stopPropagation(); act(); } };

// Keys and wheel of a chart.
const steer = (wrap, about, { zoom, pan, whole }) => {
  const keys = { ArrowLeft: () => pan(-0.25), ArrowRight: () => pan(0.25), "+": () => zoom(0.5), "-": () => zoom(2), "0": whole, Home: whole };
  wrap.className = "plot";
  wrap.tabIndex = 0;
  wrap.setAttribute("role", "group");
  wrap.setAttribute("aria-label", about + ". Arrow keys move, plus and minus zoom, 0 shows all.");
  wrap.addEventListener("keydown", (e) => {
    const act = keys[e.key];
    if (act && !e.ctrlKey && !e.metaKey && !e.altKey) { e.preventDefault(); act(); }
  });
  wrap.addEventListener("wheel", (e) => {
    if (!e.ctrlKey && !e.shiftKey) return;
    e.preventDefault();
    zoom((e.deltaY || e.deltaX) > 0 ? 1.25 : 0.8);
  }, { passive: false });
};
// Names in a legend switch their curves by keys too.
const toggles = (wrap) => {
  for (const label of wrap.querySelectorAll(".u-legend th")) {
    label.tabIndex = 0;
    label.addEventListener("keydown", (e) => press(e, () => label.click()));
  }
};
// Draws again for paper, which is light and narrower than most windows, and in other colours; fits a new width.
const whenever = (draw, fit) => {
  let waiting = 0;
  addEventListener("resize", () => { cancelAnimationFrame(waiting); waiting = requestAnimationFrame(fit); });
  addEventListener("beforeprint", () => { page.print = ""; draw(); });
  addEventListener("afterprint", () => { delete page.print; draw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
};

// A cell as a number: its time in seconds where it has a unit of time.
const worth = (cell) => {
  const found = cell.textContent.replace(/−/g, "-").match(/-?\d+(?:\.\d+)?(?:e-?\d+)?/);
  return found ? Number(found[0]) * ({ "µs": 1e-6, ms: 1e-3 }[cell.textContent.trim().split(" ").pop()] || 1) : null;
};
// Headings that sort their table: rising, then falling; what has no number comes last.
const sortable = (table) => {
  const body = table.tBodies[0];
  [...table.tHead.rows[0].cells].forEach((head, at) => {
    if (!head.textContent) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const falling = head.getAttribute("aria-sort") === "ascending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      const words = head.classList.contains("l") && ![...body.rows].some((r) => r.cells[at] && r.cells[at].classList.contains("b"));
      const keyed = [...body.rows].map((row) => ({ row, key: !row.cells[at] ? null : words ? row.cells[at].textContent : worth(row.cells[at].querySelector("[aria-label]") ? { textContent: row.cells[at].querySelector("[aria-label]").getAttribute("aria-label") } : row.cells[at]) }));
      const order = (a, b) => (a === b ? 0 : a === null ? 1 : b === null ? -1 : (words ? a.localeCompare(b) : a - b) * (falling ? -1 : 1));
      keyed.sort((a, b) => order(a.key, b.key)).forEach(({ row }) => body.append(row));
    });
  });
};
document.querySelectorAll("table.sorts").forEach(sortable);

// Curves or points over a common x, which may be logarithmic: { x: { label, log, values, ticks }, y: { label, log, range }, curves: [{ label, y, low, high, color, dash, width, hidden, points }], names }.
const lines = (box, v) => {
  const wrap = make("div", box);
  const { x, y } = v;
  const [first, last] = [Math.min(...x.values), Math.max(...x.values)];
  const [on, off] = x.log ? [Math.log, Math.exp] : [(t) => t, (t) => t];
  const room = last > first ? (on(last) - on(first)) * (x.tight ? 0 : 0.04) : x.log ? 1.2 : Math.abs(first) || 1;
  const ends = [on(first) - room, on(last) + room];
  let made = null;
  const go = (from, to) => {
    const width = Math.min(Math.max(to - from, (ends[1] - ends[0]) * 1e-4), ends[1] - ends[0]);
    const start = Math.min(Math.max(from, ends[0]), ends[1] - width);
    made.setScale("x", { min: off(start), max: off(start + width) });
  };
  const now = () => [on(made.scales.x.min), on(made.scales.x.max)];
  const whole = () => go(...ends);
  const zoom = (factor) => { const [a, b] = now(); const [middle, half] = [(a + b) / 2, ((b - a) / 2) * factor]; go(middle - half, middle + half); };
  const pan = (share) => { const [a, b] = now(); go(a + share * (b - a), b + share * (b - a)); };
  steer(wrap, v.about, { zoom, pan, whole });
  const there = (values) => values.map((t) => (t === null || (y.log && t <= 0) ? null : t));
  const series = [{ label: x.label, value: (_, t, __, i) => (t === null || i === null ? "–" : v.names ? v.names[i] + ", " + digits(t) : digits(t)) }];
  const [rows, bands, extra] = [[x.values], [], []];
  v.curves.forEach((c, at) => {
    const stroke = color(c.color || "c" + (at % 8));
    series.push({
      label: c.label, stroke, show: !c.hidden, width: c.width || 1.6, spanGaps: !c.gaps, value: (_, t) => digits(t),
      dash: c.dash || (c.color ? undefined : [undefined, [9, 4], [2, 3]][Math.floor(at / 8) % 3]),
      points: { show: c.points !== false, size: c.points ? 8 : 5, fill: c.points ? stroke : undefined },
      ...(c.points === "only" ? { paths: () => null } : c.held ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
    });
    rows.push(there(c.y));
    if (c.low) extra.push([c, stroke]);
  });
  for (const [c, stroke] of extra) {
    for (const edge of [c.low, c.high]) {
      series.push({ label: "", stroke: "transparent", width: 0, points: { show: false }, spanGaps: !c.gaps });
      rows.push(there(edge));
    }
    bands.push({ series: [series.length - 1, series.length - 2], fill: stroke + "2e" });
  }
  const values = (_, ticks) => ticks.map((t) => (t === null ? null : tick(t)));
  // A logarithmic axis has what is round, as much of it as has room.
  const logarithmic = (size) => ({
    splits: (u, at, low, high) => {
      const decades = Math.log10(high / low);
      const many = (at === 0 ? u.width - 80 : u.height - 40) / size;
      const steps = decades * 5 <= many ? [1, 2, 3, 5, 7] : decades * 3 <= many ? [1, 2, 5] : [1];
      const every = Math.max(1, Math.ceil(decades / Math.max(many, 1)));
      const list = [];
      for (let d = Math.floor(Math.log10(low)); d <= Math.ceil(Math.log10(high)); d++) {
        if (d % every === 0) for (const m of steps) { const t = m * 10 ** d; if (t >= low * (1 - 1e-9) && t <= high * (1 + 1e-9)) list.push(t); }
      }
      return list;
    },
    filter: (_, splits) => splits,
  });
  const upright = (_, low, high) => (low === null || !(low > 0) ? [1, 10] : high < 1.5 * low ? [low / 2, high * 2] : [low / 1.15, high * 1.15]);
  const across = { ...lined(), label: x.label, labelSize: 20, size: 36, values, ...(x.log ? logarithmic(60) : {}) };
  if (x.ticks) {
    across.splits = () => x.ticks.map((t) => t[0]);
    across.filter = (u, splits) => { let before = -1e9; return splits.map((t) => { const at = u.valToPos(t, "x"); if (at - before < 44) return null; before = at; return t; }); };
    across.values = (_, ticks) => ticks.map((t) => { const found = t !== null && x.ticks.find((k) => k[0] === t); return found ? found[1] : null; });
  }
  const marks = v.marks || [];
  made = new uPlot({
    width: wide(wrap), height: v.height || 320,
    scales: { x: { time: false, distr: x.log ? 3 : 1, range: (_, low, high) => (low === high ? [off(on(low) - 0.5), off(on(low) + 0.5)] : [low, high]) }, y: { distr: y.log ? 3 : 1, ...(y.range ? { range: y.range } : y.log ? { range: upright } : {}) } },
    axes: [across, { ...lined(), label: y.label, labelSize: 20, size: 64, values, ...(y.log ? logarithmic(24) : {}) }],
    series, bands,
    cursor: { drag: { x: true, y: false }, focus: { prox: v.curves.length > 3 ? 24 : -1 }, bind: { dblclick: () => () => { whole(); return null; } } },
    focus: { alpha: 0.3 },
    hooks: {
      drawClear: [(u) => {
        if (v.map) tiles(u, v.map);
        for (const m of marks) {
          u.ctx.save();
          u.ctx.fillStyle = color(m.color);
          if (m.value === undefined) {
            const [a, b] = m.x.map((t) => Math.min(Math.max(u.valToPos(t, "x", true), u.bbox.left), u.bbox.left + u.bbox.width));
            u.ctx.fillRect(a, u.bbox.top, Math.max(b - a, 1), u.bbox.height);
          } else {
            const at = u.valToPos(m.value, "y", true);
            if (at > u.bbox.top && at < u.bbox.top + u.bbox.height) u.ctx.fillRect(u.bbox.left, at - devicePixelRatio, u.bbox.width, 2 * devicePixelRatio);
          }
          u.ctx.restore();
        }
      }],
      draw: [(u) => {
        if (v.names) named(u, v);
      }],
    },
  }, rows, wrap);
  wrap.querySelectorAll(".u-series").forEach((row, at) => { if (at > v.curves.length) row.style.display = "none"; });
  toggles(wrap);
  whole();
  return made;
};
// Names beside points, where no other name stands.
const named = (u, v) => {
  const taken = [];
  u.ctx.save();
  u.ctx.font = 12 * devicePixelRatio + "px system-ui, sans-serif";
  u.ctx.fillStyle = color("ink");
  u.ctx.textBaseline = "middle";
  u.ctx.textAlign = "left";
  const order = v.names.map((_, i) => i).sort((a, b) => (v.first.includes(b) ? 1 : 0) - (v.first.includes(a) ? 1 : 0));
  for (const i of order) {
    const value = u.data[1][i];
    if (value === null) continue;
    const [px, py] = [u.valToPos(u.data[0][i], "x", true), u.valToPos(value, "y", true)];
    const [w, h] = [u.ctx.measureText(v.names[i]).width, 15 * devicePixelRatio];
    if (px < u.bbox.left || px > u.bbox.left + u.bbox.width) continue;
    const left = px + w + 8 * devicePixelRatio > u.bbox.left + u.bbox.width ? px - w - 7 * devicePixelRatio : px + 7 * devicePixelRatio;
    const spot = [left, py - h / 2, left + w, py + h / 2];
    if (taken.some((t) => spot[0] < t[2] && t[0] < spot[2] && spot[1] < t[3] && t[1] < spot[3])) continue;
    taken.push(spot);
    u.ctx.fillText(v.names[i], left, py);
  }
  u.ctx.restore();
};
// A map behind the axes: values 0 to 255 by column, then row, between edges; what is more has more colour.
const tiles = (u, m) => {
  const shades = bytes(m.u8);
  const rows = m.y.length - 1;
  u.ctx.save();
  u.ctx.beginPath();
  u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  u.ctx.clip();
  u.ctx.fillStyle = color("before");
  for (let c = 0; c + 1 < m.x.length; c++) {
    const [a, b] = [u.valToPos(m.x[c], "x", true), u.valToPos(m.x[c + 1], "x", true)];
    for (let r = 0; r < rows; r++) {
      const shade = shades[c * rows + r];
      if (!shade) continue;
      u.ctx.globalAlpha = shade / 255;
      const [low, high] = [u.valToPos(m.y[r], "y", true), u.valToPos(m.y[r + 1], "y", true)];
      u.ctx.fillRect(Math.round(a), Math.round(high), Math.round(b) - Math.round(a), Math.round(low) - Math.round(high));
    }
  }
  u.ctx.restore();
};

// Rows by columns, each cell in its number and more or less colour: { rows: [{ name, values, texts }], columns, head, log, caption }. More colour is worse.
const heat = (box, v) => {
  const outer = make("div", box);
  outer.className = "wide";
  outer.tabIndex = 0;
  outer.setAttribute("role", "group");
  outer.setAttribute("aria-label", v.about);
  const table = make("table", outer);
  table.className = "heat";
  make("caption", table, v.caption);
  const head = make("tr", make("thead", table));
  [v.head, ...v.columns].forEach((text, at) => { const th = make("th", head, text); th.scope = "col"; if (at === 0) th.className = "l"; });
  const bad = (t) => (v.from == null ? t : Math.abs(t - v.from));
  const all = v.rows.flatMap((r) => r.values).filter((t) => t !== null && (!v.log || t > 0)).map(bad);
  const on = v.log ? Math.log : (t) => t;
  const [low, high] = all.length ? [v.from == null ? on(Math.min(...all)) : 0, on(Math.max(...all))] : [0, 1];
  const body = make("tbody", table);
  for (const r of v.rows) {
    const row = make("tr", body);
    const name = make("th", row, r.name);
    name.scope = "row";
    name.className = "l";
    r.values.forEach((t, i) => {
      const cell = make("td", row, r.texts ? r.texts[i] : digits(t));
      const share = t === null || (v.log && bad(t) <= 0) ? 0 : high > low ? (on(bad(t)) - low) / (high - low) : 0;
      if (t !== null && share > 0) cell.style.background = "color-mix(in srgb, var(--heat) " + Math.round(100 * Math.min(share, 1)) + "%, var(--paper))";
    });
  }
  sortable(table);
  return null;
};

// Figures with pickers; a choice that another one rules out gives way.
for (const figure of data.figures || []) {
  const root = document.getElementById(figure.id);
  const bar = make("div", root);
  bar.className = "picks";
  const canvas = make("div", root);
  let [keys, chart] = [figure.views[0].keys || [], null];
  const agree = (view, upto) => view.keys.slice(0, upto).every((k, i) => k === keys[i]);
  const draw = () => {
    if (chart) chart.destroy();
    canvas.replaceChildren();
    const view = figure.views.find((v) => !v.keys || agree(v, keys.length));
    if (view.says) { const told = make("p", canvas, view.says); told.className = "faint"; }
    chart = (view.kind === "heat" ? heat : lines)(canvas, view);
  };
  const menus = (figure.pick || []).map((name, at) => {
    const label = make("label", bar, name + " ");
    const menu = make("select", label);
    menu.addEventListener("change", () => {
      keys = keys.map((k, i) => (i === at ? menu.value : k));
      // The later choices as they are, as far as there is such a view.
      const fit = (v) => v.keys.slice(at + 1).filter((k, i) => k === keys[at + 1 + i]).length;
      const left = figure.views.filter((v) => agree(v, at + 1)).sort((a, b) => fit(b) - fit(a));
      keys = left[0].keys;
      offer();
      draw();
    });
    return { label, menu };
  });
  const offer = () => menus.forEach(({ label, menu }, at) => {
    const choices = [...new Set(figure.views.filter((v) => agree(v, at)).map((v) => v.keys[at]))];
    menu.replaceChildren();
    for (const c of choices) make("option", menu, c).value = c;
    menu.value = keys[at];
    label.hidden = choices.length < 2;
  });
  offer();
  draw();
  whenever(draw, () => { if (chart) chart.setSize({ width: wide(chart.root.parentElement), height: chart.height }); });
}
