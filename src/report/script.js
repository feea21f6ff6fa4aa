"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  for (const element of document.querySelectorAll(".needs-script")) element.hidden = false;

  // Numbers as in the tables.
  const short = (value) => {
    if (value === 0 || (value >= 1e-4 && value < 1e6)) return String(Number(value.toPrecision(3)));
    const [mantissa, exponent] = value.toExponential(2).split("e");
    return `${Number(mantissa)}·10^${Number(exponent)}`;
  };
  const time = (s) =>
    s >= 3600 ? `${short(s / 3600)} h` : s >= 100 ? `${short(s / 60)} min` : s >= 0.1 ? `${short(s)} s` : `${short(1000 * s)} ms`;

  // Two pictures over each other.
  const viewer = $("viewer");
  if (viewer) {
    const [left, right, budget, kind, split] = ["left", "right", "budget", "kind", "split"].map($);
    const stage = $("stage");
    let turned = null; // null: both; else which of them is shown alone
    // As large as fits, in whole steps.
    const width = Number(stage.style.getPropertyValue("--w"));
    let zoom = [8, 4, 2].find((zoom) => zoom * width <= Math.min(document.body.clientWidth - 60, 1000)) || 1;

    const source = (choice) => {
      if (choice === "reference") {
        const own = data.variants[(choice === left.value ? right : left).value];
        return kind.value === "image" || kind.value === "mean" ? data.reference || (own && own.limit) : null;
      }
      const shown = data.variants[choice].budgets[budget.value];
      return shown && (shown[kind.value] || (kind.value === "mean" ? shown.image : kind.value === "meanError" ? shown.error : null));
    };
    const name = (select) => select.selectedOptions[0].textContent;
    const put = (image, tag, select) => {
      const path = source(select.value);
      const reached = select.value === "reference" || data.variants[select.value].budgets[budget.value];
      image.style.visibility = path ? "visible" : "hidden";
      if (path) image.src = path; else image.removeAttribute("src");
      image.alt = `${name(select)}, ${name(kind)}`;
      tag.textContent = path ? name(select) : `${name(select)}: ${reached ? "no such picture" : "not reached"}`;
    };
    const show = () => {
      put($("above"), $("left-tag"), left);
      put($("below"), $("right-tag"), right);
      const cut = turned === null ? 100 - Number(split.value) : turned === "left" ? 0 : 100;
      $("above").style.clipPath = `inset(0 ${cut}% 0 0)`;
      $("handle").style.left = `${split.value}%`;
      $("handle").hidden = turned !== null;
      $("left-tag").hidden = cut === 100;
      $("right-tag").hidden = cut === 0;
      $("flip").setAttribute("aria-pressed", String(turned !== null));
      stage.style.setProperty("--zoom", zoom);
      $("zoom-value").textContent = `${zoom}×`;
      for (const bar of viewer.querySelectorAll("[data-bar]"))
        bar.hidden = bar.dataset.bar !== (kind.value === "meanError" ? "error" : kind.value);
      viewer.style.setProperty("--stage", `${stage.clientWidth}px`);
    };
    const flip = () => { turned = turned === "left" ? "right" : "left"; show(); };
    const slide = (value) => { turned = null; split.value = value; show(); };
    const next = (select) => {
      const options = select.options;
      select.selectedIndex = (select.selectedIndex + 1) % options.length;
      show();
    };

    left.value = data.baseline;
    right.value = data.best === null || data.best === data.baseline ? (data.reference ? "reference" : 0) : data.best;
    budget.value = data.budget ?? 0;
    for (const select of [left, right, budget, kind]) select.addEventListener("change", show);
    split.addEventListener("input", () => { turned = null; show(); });
    $("flip").addEventListener("click", flip);
    $("zoom").addEventListener("click", () => { zoom = zoom >= 8 ? 1 : 2 * zoom; show(); });

    const layers = stage.querySelector(".layers");
    const drag = (event) => {
      const box = layers.getBoundingClientRect();
      slide(Math.min(100, Math.max(0, (100 * (event.clientX - box.left)) / box.width)));
    };
    layers.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      stage.focus({ preventScroll: true });
      layers.setPointerCapture(event.pointerId);
      drag(event);
    });
    layers.addEventListener("pointermove", (event) => { if (layers.hasPointerCapture(event.pointerId)) drag(event); });

    viewer.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
      const keys = {
        f: flip,
        " ": event.target.tagName === "BUTTON" ? null : flip,
        ArrowLeft: event.target === split ? null : () => slide(Number(split.value) - 2),
        ArrowRight: event.target === split ? null : () => slide(Number(split.value) + 2),
        a: () => next(left),
        d: () => next(right),
        t: () => next(budget),
        m: () => next(kind),
        z: () => $("zoom").click(),
      };
      const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (act) { event.preventDefault(); act(); }
    });
    addEventListener("resize", show);
    show();
  }

  // The error to reach: a line in the plot, and the times that the measures give.
  const level = $("level");
  const plot = document.querySelector(".curve-figure .plot");
  if (level && plot) {
    const [left, top, right, bottom] = plot.dataset.frame.split(" ").map(Number);
    const [low, high] = plot.dataset.value.split(" ").map((value) => Math.log(value));
    [level.min, level.max, level.value] = [low, high, Math.log(data.level)];
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    line.setAttribute("class", "level");
    line.setAttribute("x1", left);
    line.setAttribute("x2", right);
    plot.append(line);

    // As in the table: before its first measure or after its last, a bound is all that is known.
    const reach = (points, value) => {
      const k = points.findIndex((point) => point[1] <= value);
      if (points.length === 0) return null;
      if (k < 0) return { bound: ">", seconds: points[points.length - 1][0] };
      if (k === 0) return { bound: "<", seconds: points[0][0] };
      const [[s, a], [t, b]] = [points[k - 1], points[k]];
      const share = b > 0 ? Math.log(a / value) / Math.log(a / b) : 1;
      return { bound: "", seconds: s * (t / s) ** share };
    };
    const faster = (own, other) => {
      if (!own || !other || (own.bound && own.bound === other.bound)) return "–";
      const more = own.bound === "<" || other.bound === ">";
      const exact = !own.bound && !other.bound;
      const ratio = other.seconds / own.seconds;
      const digits = ratio >= 10 ? ratio.toFixed(0) : ratio >= 1 ? ratio.toFixed(1) : ratio.toPrecision(2);
      return `${exact ? "" : more ? "> " : "< "}${digits} ×`;
    };
    const follow = () => {
      const value = Math.exp(level.value);
      const y = bottom - ((level.value - low) / (high - low)) * (bottom - top);
      line.setAttribute("y1", y);
      line.setAttribute("y2", y);
      const text = short(value);
      $("level-output").textContent = text;
      level.setAttribute("aria-valuetext", `RMSE ${text}`);
      for (const element of document.querySelectorAll(".level-value")) element.textContent = text;
      const reached = data.variants.map((variant) => reach(variant.points, value));
      const told = (found) => (found ? `${found.bound && found.bound + " "}${time(found.seconds)}` : "–");
      $("level-times").textContent = data.variants.map((variant, k) => `${variant.name} ${told(reached[k])}`).join(", ");
      data.variants.forEach((variant, k) => {
        const row = document.querySelector(`tr[data-row="${k}"]`);
        if (!row) return;
        row.querySelector(".reach").textContent = told(reached[k]);
        row.querySelector(".faster").textContent = k === data.baseline ? "1 ×" : faster(reached[k], reached[data.baseline]);
      });
    };
    level.addEventListener("input", follow);
    follow();
  }
})();
