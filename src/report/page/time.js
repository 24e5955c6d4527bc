// Curves over time: every chart shares the time axis and the cursor of the others.
(() => {
  if (!data.logs) return;
  const root = document.getElementById("plots");
  let charts = [];
  let range = null;
  let linking = false;
  let log = null;
  const shown = make("output");
  shown.setAttribute("aria-live", "polite");

  const link = (chart, key) => {
    if (key !== "x" || linking) return;
    const { min, max } = chart.scales.x;
    if (min === null || max === null || min === undefined || max === undefined) return;
    linking = true;
    range = [min, max];
    for (const other of charts) if (other !== chart) other.setScale("x", { min, max });
    shown.textContent = digits(min) + " to " + digits(max) + " s" + log.thinned;
    linking = false;
  };
  const go = (min, max) => {
    const [first, last] = log.ends;
    const width = Math.min(Math.max(max - min, (last - first) * 1e-5), last - first);
    const from = Math.min(Math.max(min, first), last - width);
    if (charts.length) charts[0].setScale("x", { min: from, max: from + width });
  };
  const zoom = (factor) => {
    const middle = (range[0] + range[1]) / 2;
    const half = ((range[1] - range[0]) / 2) * factor;
    go(middle - half, middle + half);
  };
  const pan = (share) => {
    const step = (range[1] - range[0]) * share;
    go(range[0] + step, range[1] + step);
  };
  const whole = () => go(...log.ends);
  const acts = { zoom, pan, whole };

  // A stretch of time behind the curves; a band of values.
  const behind = (marks) => (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    for (const m of marks) {
      ctx.fillStyle = color(m.color);
      if (m.time) {
        const from = Math.max(u.valToPos(m.time[0], "x", true), bbox.left);
        const to = Math.min(u.valToPos(m.time[1], "x", true), bbox.left + bbox.width);
        if (to > from) ctx.fillRect(from, bbox.top, to - from, m.edge ? 4 * devicePixelRatio : bbox.height);
      } else {
        const top = Math.max(u.valToPos(m.value[1], "y", true), bbox.top);
        const end = Math.min(u.valToPos(m.value[0], "y", true), bbox.top + bbox.height);
        if (end > top) ctx.fillRect(bbox.left, top, bbox.width, end - top);
      }
    }
    ctx.restore();
  };

  const chart = (x, part, sync) => {
    const wrap = make("div", root);
    steer(wrap, part.about, acts);
    const axis = lined();
    const series = part.curves.map((c) => {
      const { usual, seldom } = spacing(x, c.y);
      // Only more than one and a half of the usual distance without a sample interrupts a curve.
      const gaps = (u, _series, _from, _to, all) => {
        const most = Math.abs(u.valToPos(x[0] + 1.5 * usual, "x", true) - u.valToPos(x[0], "x", true));
        return all.filter((gap) => gap[1] - gap[0] > most + 1);
      };
      return {
        label: c.label,
        scale: c.scale || "y",
        stroke: color(c.color),
        width: c.width || 1.25,
        dash: c.dash,
        gaps,
        points: seldom ? { show: true, size: 4 } : { size: 4 },
        paths: c.held ? uPlot.paths.stepped({ align: 1 }) : undefined,
        value: (_, v) => digits(v),
      };
    });
    const values = (_, ticks) => ticks.map(tick);
    const scales = { x: { time: false }, y: part.about_zero ? { range: (_, low, high) => { const m = 1.08 * Math.max(Math.abs(low), Math.abs(high), part.about_zero); return [-m, m]; } } : {} };
    const axes = [
      { ...axis, label: part.last ? "time (s)" : undefined, labelSize: 18, size: part.last ? 34 : 26, values },
      { ...axis, size: 64, space: 26, label: part.unit, labelSize: 18, values },
    ];
    if (part.curves.some((c) => c.scale === "z")) {
      scales.z = {};
      axes.push({ ...axis, side: 1, scale: "z", size: 56, space: 26, grid: { show: false }, label: part.unit_z, labelSize: 18, values });
    }
    const made = new uPlot({
      width: wide(wrap),
      height: part.height,
      scales,
      axes,
      series: [{ label: "time", value: (_, v) => (v === null ? "–" : digits(v) + " s") }, ...series],
      cursor: { sync: { key: sync, setSeries: false }, drag: { x: true, y: false } },
      hooks: { drawClear: [behind(part.marks)], setScale: [link] },
    }, [x, ...part.curves.map((c) => c.y)], wrap);
    toggles(wrap);
    charts.push(made);
  };

  // The stretch in which the most squared error lies for its length: a twelfth of the log, at least sixty points.
  const densest = (x, rests) => {
    const n = x.length;
    const length = Math.min(n, Math.max(60, Math.round(n / 12)));
    const weight = new Float64Array(n);
    for (const { rest, floor } of rests) {
      const scale = rest.reduce((sum, v) => sum + (v === null ? 0 : v * v), 0) || 1;
      rest.forEach((v, i) => { if (v !== null) weight[i] += Math.max(v * v - floor * floor, 0) / scale; });
    }
    let sum = 0;
    let best = 0;
    let at = 0;
    for (let i = 0; i < n; i++) {
      sum += weight[i] - (i >= length ? weight[i - length] : 0);
      if (i >= length - 1 && sum > best * (1 + 1e-9)) { best = sum; at = i - length + 1; }
    }
    return [x[at], x[Math.min(at + length, n) - 1]];
  };

  const parts = {
    // One output: measured and simulated above what is left; the commands come last.
    gap: (l) => {
      const list = [];
      const rests = [];
      for (const o of l.outputs) {
        const [y, before, after] = [curve(o.measured), curve(o.before), o.after && curve(o.after)];
        const rest = minus(y, before);
        rests.push({ rest, floor: o.floor });
        const marks = (l.held ? [{ time: l.held, color: "held" }] : []).concat(o.spans.map((s) => ({ time: s, color: "span", edge: true })));
        const curves = [{ label: "measured", color: "measured", width: 2.4, y }, { label: "simulated", color: "before", y: before }];
        const left = [{ label: "measured − simulated", color: "before", y: rest }];
        if (after) {
          curves.push({ label: "with causes", color: "after", dash: [7, 3], width: 1.6, y: after });
          left.push({ label: "measured − with causes", color: "after", y: minus(y, after) });
        }
        list.push({ title: o.name, about: o.name + ", measured and simulated over time", height: 230, unit: o.unit, marks, curves });
        list.push({ about: o.name + ", residual over time", height: 150, unit: o.unit, marks: marks.concat([{ value: [-o.floor, o.floor], color: "floor" }]), curves: left, about_zero: 1.2 * o.floor });
      }
      for (const i of l.inputs) {
        list.push({ title: i.name, about: "command " + i.name + " over time", height: 120, unit: i.unit, marks: l.held ? [{ time: l.held, color: "held" }] : [], curves: [{ label: "command", color: "input", held: true, y: curve(i.values) }] });
      }
      return { list, rests };
    },
    // Input and output as logged, and the output shifted back by the answer.
    estimate: (l) => {
      const list = [];
      const named = (name, unit) => (unit ? name + " (" + unit + ")" : name);
      for (const p of l.pairs) {
        const [u, y] = [curve(p.u), curve(p.y)];
        const two = (title, about, out, label) => ({ title, about, height: 210, unit: named("input", p.unit_u), unit_z: named("output", p.unit_y), marks: [], curves: [{ label: p.label_u, color: "input", held: true, y: u }, { label, color: "after", scale: "z", width: 1.6, y: out }] });
        list.push(two(p.input + " → " + p.output, p.input + " and " + p.output + " over time", y, "output"));
        if (p.delay_s !== null) {
          list.push(two(undefined, p.output + " shifted back by " + digits(p.delay_s) + " s", back(l.x, y, p.delay_s), "output, " + digits(p.delay_s) + " s earlier"));
        }
      }
      return { list, rests: l.pairs.map((p) => ({ rest: slopes(curve(p.u)), floor: 0 })) };
    },
  };
  const slopes = (y) => y.map((v, i) => (i === 0 || v === null || y[i - 1] === null ? null : v - y[i - 1]));
  // y(t + d) on the times of y, along straight lines; missing where a neighbour is.
  const back = (x, y, d) => {
    let k = 0;
    return Array.from(x, (t) => {
      while (k + 1 < x.length && x[k + 1] < t + d) k++;
      if (k + 1 >= x.length) return null;
      const share = (t + d - x[k]) / (x[k + 1] - x[k]);
      if (share <= 1e-6) return y[k];
      if (share >= 1 - 1e-6) return y[k + 1];
      return y[k] === null || y[k + 1] === null ? null : y[k] + share * (y[k + 1] - y[k]);
    });
  };

  const draw = (at, keep) => {
    const held = keep && range;
    charts.forEach((c) => c.destroy());
    charts = [];
    root.replaceChildren();
    const l = data.logs[at];
    const x = times(l.time);
    const thinned = l.bucket > 1 ? "; of every " + l.bucket + " samples the least and the greatest" : "";
    log = { x, ends: [x[0], x[x.length - 1]], thinned };
    const { list, rests } = parts[data.kind]({ ...l, x });
    list.forEach((part, i) => {
      if (part.title !== undefined) make("h3", root, part.title);
      part.last = i === list.length - 1;
      chart(x, part, "page");
    });
    log.dense = densest(x, rests);
    if (held) go(...held); else go(...log.dense);
  };

  const tools = document.getElementById("tools");
  const button = (text, about, act) => {
    const made = make("button", tools, text);
    made.type = "button";
    made.title = about;
    made.addEventListener("click", act);
  };
  let current = 0;
  if (data.logs.length > 1) {
    const label = make("label", tools, "Log ");
    const pick = make("select", label);
    data.logs.forEach((l, i) => { make("option", pick, i + 1 + ": " + l.name).value = i; });
    pick.value = current = data.opens || 0;
    pick.addEventListener("change", () => draw((current = Number(pick.value)), false));
  }
  button(data.kind === "gap" ? "Where the gap is densest" : "Where the input moves most", "Zoom to it", () => go(...log.dense));
  button("All", "The whole log", whole);
  button("−", "Zoom out", () => zoom(2));
  button("+", "Zoom in", () => zoom(0.5));
  button("◀", "Earlier", () => pan(-0.5));
  button("▶", "Later", () => pan(0.5));
  tools.append(shown);

  if (data.logs.length) {
    draw(current, false);
    whenever(() => draw(current, true), () => charts.forEach((c) => c.setSize({ width: wide(c.root.parentElement), height: c.height })));
    page.drawn = charts.length;
  }
})();
