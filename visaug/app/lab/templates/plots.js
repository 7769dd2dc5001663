// Curves (uPlot) and maps (canvas) of measured and modelled values: zoom, pan, values under the pointer, CSV.
"use strict";

const Plots = (() => {
  const views = new Map(); // what the reader chose, by name of the figure: {x: [from, to], mode, region}
  const ink = (who) => getComputedStyle(document.documentElement).getPropertyValue(`--${who}`).trim();
  const DASHES = [[], [8, 4], [2, 3], [8, 3, 2, 3]];
  const chosen = (name) => { if (!views.has(name)) views.set(name, {}); return views.get(name); };
  const make = (tag, given = {}, ...inside) => {
    const made = Object.assign(document.createElement(tag), given);
    made.append(...inside);
    return made;
  };
  const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
  const shown = (value, digits = 5) => value == null || !isFinite(value) ? "–" : Number(value.toPrecision(digits)).toString();
  let changed = () => {};

  function button(label, title, act) {
    const made = make("button", { type: "button", className: "small", textContent: label, title, onclick: act });
    made.setAttribute("aria-label", title);
    return made;
  }

  function download(name, text) {
    const file = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    make("a", { href: file, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(file), 60000);
  }

  // Curves ------------------------------------------------------------------------------------------------

  function csv(data, names, chosen) {
    const quoted = (text) => `"${String(text).replaceAll('"', '""')}"`;
    const lines = [["curve", data.x_label || "x", ...names.map((n) => `${n}, ${data.y_label}`)].map(quoted).join(",")];
    chosen.forEach((c) => c.x.forEach((x, i) => lines.push([quoted(c.label), x, ...c.y.map((y) => y[i] ?? "")].join(","))));
    return lines.join("\r\n") + "\r\n";
  }

  const range = (curve) => {
    const ys = curve.y.flat().filter((y) => y != null);
    return ys.length ? Math.max(...ys) - Math.min(...ys) : 0;
  };

  // Curves whose ranges differ much get axes of their own, or one would hide the other.
  function panels(data) {
    const spans = data.curves.map(range);
    const apart = !data.log_y && data.curves.length > 1 && data.curves.length < 4 && Math.max(...spans) > 4 * Math.min(...spans);
    return apart ? data.curves.map((curve) => [curve]) : [data.curves];
  }

  function joined(curves) {
    const tables = curves.map((c) => [c.x, ...c.y]);
    return tables.length > 1 ? uPlot.join(tables, tables.map((t) => t.slice(1).map(() => 2))) : tables[0];
  }

  function drawCurves(figure, name, data) {
    panels(data).forEach((curves, place) => {
      const state = chosen(`${name}/${place}`);
      const values = joined(curves);
      const positive = values[0].every((x) => x > 0);
      const many = curves.length > 1;
      const line = dark() ? "#c9d2dd" : "#3c4654", grid = { stroke: dark() ? "#333c48" : "#e6eaef", width: 1 };
      const series = [{ label: data.x_label || "x", value: (_, v) => shown(v) }];
      curves.forEach((curve, i) => data.names.forEach((who, k) => series.push({
        label: many ? `${who}, ${curve.label}` : who, stroke: ink(k ? "modelled" : "measured"), width: k ? 2.5 : 1.3,
        alpha: k ? 0.65 : 1, dash: DASHES[i % DASHES.length], spanGaps: true, value: (_, v) => shown(v),
        points: { show: values[0].length <= 24, size: 6 },
      })));
      const holder = make("div", { className: "curves" });
      const heading = [many ? "" : curves[0].label, data.y_label].filter(Boolean).join(" · ");
      holder.append(make("p", { className: "note panel", textContent: heading }));
      figure.append(holder);
      const width = () => Math.max(240, holder.clientWidth);
      const number = (_, splits) => splits.map((v) => v == null ? "" : shown(v));
      // a logarithmic axis begins above zero
      const logged = data.log_y && values.slice(1).flat().some((y) => y > 0);
      if (logged) for (let k = 1; k < values.length; k++) values[k] = values[k].map((y) => y > 0 ? y : null);
      const plot = new uPlot({
        width: width(), height: 260, series,
        scales: { x: { time: false, distr: data.log_x && positive ? 3 : 1 }, y: { distr: logged ? 3 : 1 } },
        axes: [
          { label: data.x_label, labelFont: "12px system-ui, sans-serif", stroke: line, grid, labelSize: 20, size: 38, values: data.log_x ? undefined : number },
          { stroke: line, grid, size: 62, values: logged ? undefined : number },
        ],
        cursor: { sync: { key: data.x_label || name, scales: ["x", null] }, drag: { x: true, y: false }, focus: { prox: 30 } },
        legend: { live: true },
        hooks: { drawClear: [(u) => (data.marks || []).forEach(([low, high]) => {  // the places that the picture is about
          const left = u.valToPos(low, "x", true), right = u.valToPos(high, "x", true);
          const from = Math.max(left, u.bbox.left), to = Math.min(Math.max(right, left + 2), u.bbox.left + u.bbox.width);
          if (to <= from) return;
          u.ctx.fillStyle = "rgba(122, 132, 148, 0.2)";
          u.ctx.fillRect(from, u.bbox.top, to - from, u.bbox.height);
        })], setScale: [(u, key) => {
          if (key !== "x") return;
          const { min, max } = u.scales.x, all = values[0];
          state.x = min > all[0] || max < all[all.length - 1] ? [min, max] : undefined;
          changed();
        }] },
      }, values, holder);
      if (state.x) plot.setScale("x", { min: state.x[0], max: state.x[1] });
      new ResizeObserver(() => plot.setSize({ width: width(), height: 260 })).observe(holder);
      holder.setAttribute("role", "group");
      holder.setAttribute("aria-label", `${data.title}: ${data.names.join(" and ")}`);
      const move = (shift, grow) => {
        const all = values[0], first = all[0], last = all[all.length - 1];
        const { min, max } = plot.scales.x, span = (max - min) * grow, middle = (min + max) / 2 + shift * (max - min);
        let from = middle - span / 2, to = middle + span / 2;
        if (from < first) { to += first - from; from = first; }
        if (to > last) { from -= to - last; to = last; }
        plot.setScale("x", { min: Math.max(from, first), max: to });
      };
      holder.append(make("div", { className: "tools plot-tools" },
        button("+", "zoom in", () => move(0, 0.5)), button("−", "zoom out", () => move(0, 2)),
        button("←", "move left", () => move(-0.25, 1)), button("→", "move right", () => move(0.25, 1)),
        button("All", "show everything", () => plot.setScale("x", { min: values[0][0], max: values[0].at(-1) })),
        button("CSV", `CSV of ${data.title}`, () => download(`${name}.csv`, csv(data, data.names, curves)))));
    });
  }

  // Maps --------------------------------------------------------------------------------------------------

  const cividis = [[0, 34, 78], [35, 62, 108], [87, 92, 109], [123, 121, 121], [162, 152, 118], [206, 187, 95], [254, 232, 56]];
  const split = [[8, 64, 129], [67, 147, 195], [209, 229, 240], [247, 247, 247], [253, 219, 199], [230, 125, 60], [166, 60, 0]];
  function colour(stops, share, out, at) {
    const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(place), stops.length - 2), f = place - i;
    for (let c = 0; c < 3; c++) out[at + c] = stops[i][c] * (1 - f) + stops[i + 1][c] * f;
    out[at + 3] = 255;
  }

  function decoded(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  function percentiles(arrays) {
    const some = [];
    arrays.forEach((a) => { const step = Math.max(1, Math.floor(a.length / 20000)); for (let i = 0; i < a.length; i += step) if (isFinite(a[i])) some.push(a[i]); });
    some.sort((a, b) => a - b);
    const low = some[Math.floor(0.01 * (some.length - 1))], high = some[Math.ceil(0.99 * (some.length - 1))];
    return high > low ? [low, high] : [low - 0.5, low + 0.5];
  }

  function drawMaps(figure, name, data, maps) {
    const state = chosen(name);
    state.mode ??= 0;
    let flicker = 0;
    const words = [...data.names, "difference"];
    const modes = make("div", { className: "tools plot-tools" });
    modes.setAttribute("role", "group");
    modes.setAttribute("aria-label", `what the picture shows: ${data.title}`);
    const grid = make("div", { className: "maps" });
    const redraws = [];
    const redraw = () => {
      redraws.forEach((each) => each());
      [...modes.children].forEach((each, i) => { if (i < 3) each.setAttribute("aria-pressed", String(state.mode === i)); });
    };
    const set = (mode) => { state.mode = mode; redraw(); changed(); };
    words.forEach((word, i) => modes.append(button(word, word, () => { stop(); set(i); })));
    const flickers = button("flicker", `alternate ${data.names.join(" and ")}`, () => {
      if (flicker) { stop(); return; }
      flickers.setAttribute("aria-pressed", "true");
      flicker = setInterval(() => { if (grid.isConnected) set(state.mode === 0 ? 1 : 0); else stop(); }, 700);
    });
    const stop = () => { clearInterval(flicker); flicker = 0; flickers.setAttribute("aria-pressed", "false"); };
    const whole = () => { state.region = undefined; redraw(); changed(); };
    modes.append(flickers, button("All", "show everything", whole));
    figure.append(modes, grid);

    maps.forEach((map) => {
      const [first, second] = map.values.map(decoded);
      const picture = data.white !== undefined; // before and after: the difference is what was added
      const difference = first.map((v, i) => picture ? second[i] - v : v - second[i]);
      const limits = picture ? [0, data.white] : percentiles([first, second]);
      const shade = (v) => 255 * (data.is_light ? (Math.max(v, 0) / data.white) ** (1 / 2.2) : v / data.white); // as a screen shows it
      const half = picture ? Math.max(...percentiles([difference]).map(Math.abs)) : (limits[1] - limits[0]) / 2;
      const canvas = make("canvas", { tabIndex: 0 });
      canvas.setAttribute("role", "img");
      const said = make("p", { className: "note value", textContent: "point at a pixel for its value; drag to zoom, arrow keys and + − 0 do the same" });
      const scale = make("p", { className: "note scale-text" });
      grid.append(make("div", { className: "map" }, make("p", { className: "note panel", textContent: maps.length > 1 ? map.title : picture ? data.title : "" }), canvas, scale, said));
      const region = () => state.region ?? [0, 0, map.width, map.height];
      const draw = () => {
        const [x0, y0, x1, y1] = region(), w = x1 - x0, h = y1 - y0;
        canvas.width = w; canvas.height = h;
        const context = canvas.getContext("2d"), image = context.createImageData(w, h);
        const source = [first, second, difference][state.mode], channels = map.channels;
        for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) {
          const at = 4 * (y * w + x), from = ((y + y0) * map.width + x + x0) * channels;
          if (channels === 3) {
            for (let c = 0; c < 3; c++) image.data[at + c] = state.mode === 2 ? 255 * (0.5 + source[from + c] / (2 * half)) : shade(source[from + c]);
            image.data[at + 3] = 255;
          } else if (state.mode === 2) colour(split, 0.5 + source[from] / (2 * half), image.data, at);
          else if (picture) { image.data.fill(shade(source[from]), at, at + 3); image.data[at + 3] = 255; }
          else colour(cividis, (source[from] - limits[0]) / (limits[1] - limits[0]), image.data, at);
        }
        context.putImageData(image, 0, 0);
        canvas.setAttribute("aria-label", `${map.title}, ${words[state.mode]}`);
        scale.textContent = `${words[state.mode]}: colours from ${(state.mode === 2 ? [-half, half] : limits).map((v) => shown(v, 3)).join(" to ")}${data.y_label ? ` (${data.y_label})` : ""}`
          + (map.step > 1 ? `; each point is the mean of ${map.step} × ${map.step} pixels` : "");
      };
      redraws.push(draw);
      const pixel = (event) => {
        const box = canvas.getBoundingClientRect(), [x0, y0, x1, y1] = region();
        const at = (v, size, from, to) => Math.min(Math.max(Math.floor(from + v / size * (to - from)), from), to - 1);
        return [at(event.clientX - box.left, box.width, x0, x1), at(event.clientY - box.top, box.height, y0, y1)];
      };
      let here = [0, 0], began = null;
      const tell = () => {
        const at = (here[1] * map.width + here[0]) * map.channels;
        const value = (array) => Array.from(array.subarray(at, at + map.channels), (v) => shown(v)).join(" ");
        said.textContent = `row ${here[1] * map.step}, column ${here[0] * map.step}: ${data.names[0]} ${value(first)}, ${data.names[1]} ${value(second)}, difference ${value(difference)}`;
      };
      const zoom = (grow) => {
        const [x0, y0, x1, y1] = region(), w = Math.min(map.width, Math.max(8, Math.round((x1 - x0) * grow))), h = Math.min(map.height, Math.max(8, Math.round((y1 - y0) * grow)));
        const left = Math.min(Math.max(0, here[0] - (w >> 1)), map.width - w), top = Math.min(Math.max(0, here[1] - (h >> 1)), map.height - h);
        state.region = [left, top, left + w, top + h]; redraw(); changed();
      };
      canvas.onpointerdown = (event) => { began = pixel(event); };
      canvas.onpointermove = (event) => { here = pixel(event); tell(); };
      canvas.onpointerup = (event) => {
        const [a, b] = [began, pixel(event)];
        began = null;
        if (!a || Math.abs(a[0] - b[0]) < 4 || Math.abs(a[1] - b[1]) < 4) return;
        state.region = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[0], b[0]), Math.max(a[1], b[1])];
        redraw(); changed();
      };
      canvas.ondblclick = whole;
      canvas.onkeydown = (event) => {
        const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
        if (step) {
          here = [Math.min(Math.max(here[0] + step[0], 0), map.width - 1), Math.min(Math.max(here[1] + step[1], 0), map.height - 1)];
          const [x0, y0, x1, y1] = region();
          const dx = here[0] < x0 ? here[0] - x0 : here[0] >= x1 ? here[0] - x1 + 1 : 0, dy = here[1] < y0 ? here[1] - y0 : here[1] >= y1 ? here[1] - y1 + 1 : 0;
          if (dx || dy) { state.region = [x0 + dx, y0 + dy, x1 + dx, y1 + dy]; redraw(); changed(); }
          tell();
        } else if (event.key === "+") zoom(0.5);
        else if (event.key === "-") zoom(2);
        else if (event.key === "0") whole();
        else return;
        event.preventDefault();
      };
    });
    redraw();
  }

  function draw(figure, name, data) {
    figure.replaceChildren();
    figure.classList.toggle("wide", data.maps.length > 1 || panels(data).length > 1);
    if (data.curves.length) drawCurves(figure, name, data);
    // maps of one size share their zoom; others get their own
    const sizes = Map.groupBy ? [...Map.groupBy(data.maps, (m) => `${m.width}x${m.height}`).values()] : data.maps.map((m) => [m]);
    sizes.forEach((maps, i) => drawMaps(figure, i ? `${name}-${i}` : name, data, maps));
  }

  return {
    draw,
    state: () => Object.fromEntries([...views].filter(([, v]) => v.x || v.region || v.mode)),
    restore: (state) => Object.entries(state).forEach(([name, v]) => views.set(name, v)),
    onChange: (act) => { changed = act; },
  };
})();
