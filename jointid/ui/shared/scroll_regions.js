// Wide equations, tables and listings: reached by keyboard, or stacked on a phone.
const MOST_STACKED = 24;  // lines; a longer table is set in small print, and scrolls if still too wide
const HIGHEST_NAME = 120;  // pixels, of a cell in the first column: about five lines
const WIDE = "pre, .katex-display, [data-testid=stTable] div";
let waiting;

function mark() {
  for (const region of document.querySelectorAll(WIDE)) {
    const wide = region.scrollWidth > region.clientWidth + 1;
    const high = region.scrollHeight > region.clientHeight + 1;
    if ((wide || high) && /auto|scroll/.test(getComputedStyle(region).overflow)) region.tabIndex = 0;
    else region.removeAttribute("tabindex");
  }
  // On a phone, the rows of a table that would be cut off are stacked, headings before their cells.
  for (const table of document.querySelectorAll("[data-testid=stTable] table")) {
    const headings = [...table.querySelectorAll("th")].map((each) => each.textContent);
    table.classList.remove("stacked", "small");
    const names = [...table.querySelectorAll("td:first-child")];
    const cut = table.scrollWidth > table.parentElement.clientWidth + 1
      || names.some((name) => name.offsetHeight > HIGHEST_NAME);
    const lines = headings.length * (table.rows.length - 1);
    if (innerWidth <= 640 && cut) table.classList.add(lines <= MOST_STACKED ? "stacked" : "small");
    table.querySelectorAll("td").forEach((cell) => { cell.dataset.heading = headings[cell.cellIndex]; });
  }
  // An upload area has a name and takes the focus: it is no mere decoration.
  for (const area of document.querySelectorAll("section[role=presentation][aria-label]"))
    area.setAttribute("role", "group");
}

export default function () {
  const later = () => { waiting ??= setTimeout(() => { waiting = undefined; mark(); }, 100); };
  const changes = new MutationObserver(later);
  changes.observe(document.body, { childList: true, subtree: true });
  addEventListener("resize", later);
  document.fonts.addEventListener("loadingdone", later);  // of formulas
  later();
  return () => {
    changes.disconnect();
    removeEventListener("resize", later);
    document.fonts.removeEventListener("loadingdone", later);
  };
}
