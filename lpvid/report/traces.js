/* Draws every figure of class "traces" with uPlot: a common cursor and zoom over its panels, and no more points than
   pixels: of every bin of samples on view the lowest and the highest, in their order. */
(() => {
  "use strict";
  const MISSING = -32768, LEVELS = 65534, AXIS = 84, BEYOND = 12, TALLEST = 200, PER_PIXEL = 1;
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  async function inflated(text) {
    const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /* One curve: values and a function from index to time. */
  async function unpack(curve, panel) {
    const planes = await inflated(curve.values), n = curve.n, values = new Float64Array(n);
    let code = 0;
    for (let i = 0; i < n; i++) {
      code = (code + (planes[i] | planes[n + i] << 8)) & 65535;
      const signed = code > 32767 ? code - 65536 : code;
      values[i] = signed === MISSING ? NaN : panel.low + (signed + LEVELS / 2) / LEVELS * (panel.high - panel.low);
    }
    if (curve.clock) {
      const [start, pace] = curve.clock;
      return {values, n, time: i => start + pace * i, place: t => Math.ceil((t - start) / pace)};
    }
    const times = new Float64Array((await inflated(curve.times)).buffer);
    return {values, n, time: i => times[i], place: t => {
      let low = 0, high = n;
      while (low < high) { const mid = (low + high) >> 1; if (times[mid] < t) low = mid + 1; else high = mid; }
      return low;
    }};
  }

  /* [times, values] of a curve between two times: its own samples, or the extremes of as many bins as asked for. */
  function stretch(curve, from, to, bins) {
    const first = Math.max(0, curve.place(from) - 1), last = Math.min(curve.n, curve.place(to) + 2);
    const x = [], y = [];
    if (last - first <= 2 * bins) {
      for (let i = first; i < last; i++) {
        x.push(curve.time(i)); y.push(Number.isNaN(curve.values[i]) ? null : curve.values[i]);
      }
      return [x, y];
    }
    const width = (to - from) / bins;
    let i = first;
    for (let b = 0; b < bins; b++) {
      const end = b === bins - 1 ? last : Math.min(last, curve.place(from + (b + 1) * width));
      let low = -1, high = -1;
      for (; i < end; i++) {
        const v = curve.values[i];
        if (Number.isNaN(v)) continue;
        if (low < 0 || v < curve.values[low]) low = i;
        if (high < 0 || v > curve.values[high]) high = i;
      }
      const early = from + (b + 0.25) * width, late = from + (b + 0.75) * width;
      x.push(early, late);
      if (low < 0) y.push(null, null);
      else y.push(curve.values[Math.min(low, high)], curve.values[Math.max(low, high)]);
    }
    return [x, y];
  }

  /* Multiples of a step within a range; of a smaller step where these are fewer than two, so that a scale can be read.
     As steps go by 1, 2, 2.5, 5, a smaller one has at most four, which even the lowest panel has room for. */
  function ticks(low, high, step) {
    let power = 10 ** Math.floor(Math.log10(step || high - low)), mantissa = step ? step / power : 10;
    const count = () => Math.floor(high / (mantissa * power)) - Math.ceil(low / (mantissa * power)) + 1;
    while (count() < 2) {
      mantissa = [5, 2.5, 2, 1, 0.5].find(m => m < mantissa - 1e-9);
      if (mantissa < 1) { mantissa = 5; power /= 10; }
    }
    const first = Math.ceil(low / (mantissa * power));
    return Array.from({length: count()}, (_, k) => (first + k) * mantissa * power);
  }

  const digits = v => v == null ? "–" : String(Number(v.toPrecision(5)));

  /* A number beside an axis, in at most seven characters where that is possible: so much room there is. */
  function brief(v) {
    const plain = digits(v), powers = Number(v.toPrecision(5)).toExponential();
    return plain.length > 7 && powers.length < plain.length ? powers : plain;
  }

  class Figure {
    constructor(root) {
      this.root = root;
      this.data = JSON.parse(root.querySelector("script").textContent);
      this.body = root.querySelector(".plots");
      this.charts = [];
    }

    async draw() {
      if (this.started) return;
      this.started = true;
      for (const panel of this.data.panels) panel.drawn = await Promise.all(panel.curves.map(c => unpack(c, panel)));
      const drawn = this.data.panels.flatMap(p => p.drawn).filter(c => c.n);
      this.whole = [Math.min(...drawn.map(c => c.time(0))), Math.max(...drawn.map(c => c.time(c.n - 1)))];
      if (!(this.whole[1] > this.whole[0])) this.whole[1] = this.whole[0] + 1;
      this.view = this.whole;
      this.body.replaceChildren();
      this.buttons();
      this.sync = uPlot.sync(this.root.id);
      this.data.panels.forEach((panel, i) => this.charts.push(this.chart(panel, i === this.data.panels.length - 1)));
      await null;  // uPlot lays its charts out in a task of its own
      this.charts.forEach((u, i) => this.heighten(u, this.data.panels[i].label));
      new ResizeObserver(() => this.fit()).observe(this.body);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
        for (const u of this.charts) u.redraw(false, true);
      });
      this.root.dataset.points = this.points;
      this.root.dataset.ready = Math.round(performance.now());
    }

    width() { return Math.max(240, Math.floor(this.body.clientWidth)); }

    /* Aligned data of one panel for the stretch on view. */
    table(panel) {
      const bins = Math.max(50, Math.round(PER_PIXEL * (this.width() - AXIS)));
      const parts = panel.drawn.map(c => stretch(c, this.view[0], this.view[1], bins));
      const same = parts.every(p => p[0].length === parts[0][0].length && p[0].every((x, i) => x === parts[0][0][i]));
      return same ? [parts[0][0], ...parts.map(p => p[1])] : uPlot.join(parts.map(p => [p[0], p[1]]));
    }

    chart(panel, last) {
      const axis = {stroke: () => colour("--muted"), grid: {stroke: () => colour("--line"), width: 1},
        ticks: {stroke: () => colour("--line"), width: 1}, font: "12px system-ui, sans-serif",
        labelFont: "12px system-ui, sans-serif"};
      const joined = panel.drawn.some(c => c.n !== panel.drawn[0].n);
      const series = panel.curves.map(c => ({label: c.name, stroke: () => colour("--curve-" + c.role),
        width: c.role === "measured" ? 1.4 : 1.1, spanGaps: joined, points: {show: false},
        value: (u, v) => digits(v), ...(c.stepped ? {paths: uPlot.paths.stepped({align: 1})} : {})}));
      const options = {
        width: this.width(), height: panel.height + (last ? 42 : 14), series: [{label: "time [s]",
          value: (u, v) => digits(v)}, ...series],
        scales: {x: {time: false, range: () => this.view}, y: {range: (u, low, high) => this.reach(panel, low, high)}},
        axes: [{...axis, size: last ? 42 : 14, label: last ? "time [s]" : undefined, labelSize: 18,
          values: last ? undefined : (u, splits) => splits.map(() => "")},
          {...axis, label: panel.label, size: AXIS - 18, labelSize: 18, values: (u, s) => s.map(brief),
            splits: (u, i, low, high, step) => ticks(low, high, step)}],
        cursor: {sync: {key: this.root.id, setSeries: false}, drag: {x: true, y: false, setScale: false},
          points: {size: 6}, bind: {dblclick: () => () => { this.show(this.whole); return null; }}},
        hooks: {setSelect: [u => this.selected(u)], drawClear: [u => this.shade(u)]},
      };
      return new uPlot(options, this.table(panel), this.body);
    }

    /* Makes room for the label beside a low panel: it is centred on the panel, and reaches a little beyond it. */
    heighten(u, label) {
      const ratio = devicePixelRatio;
      u.ctx.save();
      u.ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      const short = u.ctx.measureText(label).width / ratio - u.bbox.height / ratio - BEYOND;
      u.ctx.restore();
      if (short > 0) u.setSize({width: u.width, height: u.height + Math.min(Math.ceil(short), TALLEST)});
    }

    /* Vertical range: what is on view, with a margin. */
    reach(panel, low, high) {
      if (low == null || high == null) return [panel.low, panel.high];
      const room = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
      return [low - room, high + room];
    }

    selected(u) {
      if (u.select.width < 4) return;
      const ends = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
      u.setSelect({left: 0, top: 0, width: 0, height: 0}, false);
      this.show(ends);
    }

    shade(u) {
      if (!this.data.marked) return;
      const [a, b] = this.data.marked, {left, top, width, height} = u.bbox;
      const x = [a, b].map(t => Math.min(left + width, Math.max(left, u.valToPos(t, "x", true))));
      u.ctx.save();
      u.ctx.fillStyle = colour("--shade");
      u.ctx.fillRect(x[0], top, x[1] - x[0], height);
      u.ctx.restore();
    }

    show(ends) {
      const [a, b] = this.whole, span = Math.min(Math.max(ends[1] - ends[0], 1e-9 * (b - a)), b - a);
      const from = Math.min(Math.max(ends[0], a), b - span);
      this.view = [from, from + span];
      this.charts.forEach((u, i) => u.batch(() => {
        u.setData(this.table(this.data.panels[i]), false);
        u.setScale("x", {min: this.view[0], max: this.view[1]});
      }));
    }

    zoom(factor, shift) {
      const middle = 0.5 * (this.view[0] + this.view[1]), half = 0.5 * factor * (this.view[1] - this.view[0]);
      this.show([middle - half + 2 * shift * half, middle + half + 2 * shift * half]);
    }

    fit() {
      const width = this.width();
      for (const u of this.charts) if (u.width !== width) u.setSize({width, height: u.height});
      this.show(this.view);
    }

    buttons() {
      const bar = document.createElement("div");
      bar.className = "tools";
      const add = (text, said, act) => {
        const button = document.createElement("button");
        button.type = "button"; button.textContent = text; button.title = said;
        button.setAttribute("aria-label", said);
        button.addEventListener("click", act);
        bar.append(button);
      };
      add("◀", "earlier", () => this.zoom(1, -0.4));
      add("+", "zoom in", () => this.zoom(0.5, 0));
      add("−", "zoom out", () => this.zoom(2, 0));
      add("▶", "later", () => this.zoom(1, 0.4));
      add("whole record", "show the whole record", () => this.show(this.whole));
      if (this.data.marked) add(this.data.marked[2], "zoom to " + this.data.marked[2], () => {
        const [a, b] = this.data.marked; this.show([a - 0.05 * (b - a), b + 0.05 * (b - a)]);
      });
      this.body.append(bar);
    }

    get points() { return this.data.panels.reduce((sum, p) => sum + p.drawn.reduce((s, c) => s + c.n, 0), 0); }
  }

  const figures = Array.from(document.querySelectorAll("figure.traces"), root => new Figure(root));
  const near = new IntersectionObserver(seen => {
    for (const entry of seen) if (entry.isIntersecting) {
      near.unobserve(entry.target);
      figures.find(f => f.root === entry.target).draw();
    }
  }, {rootMargin: "600px"});
  for (const figure of figures) near.observe(figure.root);
  const all = () => Promise.all(figures.map(f => f.draw()));
  addEventListener("beforeprint", all);
  window.lpvidTraces = {figures, all};
})();
