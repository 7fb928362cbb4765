// Adds SVG and CSV to the toolbar of every plotly figure; both are made in the browser.
const NS = "http://www.w3.org/2000/svg";
let watcher;

export default function () {
  watcher?.disconnect();
  let waiting = false;
  const equipAll = () => {
    waiting = false;
    document.querySelectorAll(".js-plotly-plot").forEach(equip);
  };
  watcher = new MutationObserver(() => {
    if (!waiting) requestAnimationFrame(equipAll);
    waiting = true;
  });
  watcher.observe(document.body, { childList: true, subtree: true });
  equipAll();
  return () => watcher.disconnect();
}

function equip(figure) {
  const bar = figure.querySelector(".modebar");
  if (!bar || bar.querySelector("[data-save]")) return;
  const group = document.createElement("div");
  group.className = "modebar-group";
  for (const [kind, type, write] of [
    ["SVG", "image/svg+xml", svg],
    ["CSV", "text/csv", csv],
  ]) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "modebar-btn";
    button.dataset.save = kind;
    button.dataset.title = `Save as ${kind}`;
    button.setAttribute("aria-label", `Save the figure as ${kind}`);
    button.textContent = kind;
    button.style.cssText = "font: 600 11px sans-serif; background: none; border: 0";
    button.style.color = figure._fullLayout.modebar.color;
    button.onclick = () => save(new Blob([write(figure)], { type }), `${name(figure)}.${kind.toLowerCase()}`);
    group.append(button);
  }
  bar.prepend(group);
}

function save(blob, file) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const name = (figure) => figure._context?.toImageButtonOptions?.filename || "figure";

function svg(figure) {
  const { width, height } = figure._fullLayout;
  const whole = document.createElementNS(NS, "svg");
  const size = { width, height, viewBox: `0 0 ${width} ${height}`, xmlns: NS };
  const sheet = document.createElementNS(NS, "rect");
  const fill = getComputedStyle(document.querySelector(".stApp") ?? document.body).backgroundColor;
  for (const [key, value] of Object.entries(size)) whole.setAttribute(key, value);
  for (const [key, value] of Object.entries({ width, height, fill })) sheet.setAttribute(key, value);
  whole.append(sheet);
  for (const layer of figure.querySelectorAll(".main-svg")) whole.append(...layer.cloneNode(true).childNodes);
  return new XMLSerializer().serializeToString(whole);
}

function csv(figure) {
  const layout = figure._fullLayout;
  const title = (axis) => plain(layout[axis.replace(/^(.)/, "$1axis")]?.title?.text ?? "");
  const rows = [["curve", "x quantity", "y quantity", "x", "y", "value", "standard error"]];
  for (const trace of figure._fullData) {
    const { x = trace.theta, y = trace.r, z } = trace;
    if (trace.hoverinfo === "skip" || !x || !y) continue;
    const head = [plain(trace.name ?? ""), title(trace.xaxis ?? ""), title(trace.yaxis ?? "")];
    const error = trace.error_y?.array ?? [];
    if (z) for (let i = 0; i < y.length; i++) for (let j = 0; j < x.length; j++) rows.push([...head, x[j], y[i], z[i][j], ""]);
    else for (let i = 0; i < x.length; i++) rows.push([...head, x[i], y[i], "", error[i] ?? ""]);
  }
  return rows.map((row) => row.map(cell).join(",")).join("\n") + "\n";
}

// Names hold entities and tags as plotly reads them.
const plain = (text) => new DOMParser().parseFromString(text, "text/html").body.textContent;

// A text that a spreadsheet would take for a formula gets an apostrophe in front.
function cell(value) {
  if (typeof value === "number") return String(value);
  const text = /^\s*[=+\-@\t]/.test(value ?? "") ? `'${value}` : String(value ?? "");
  return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
