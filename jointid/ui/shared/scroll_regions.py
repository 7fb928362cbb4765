"""Wide equations, tables and listings: reached by keyboard, so that the arrow keys scroll them."""

import streamlit as st

_JS = """
const WIDE = "pre, .katex-display, [data-testid=stTable] div";
let waiting;

function mark() {
  for (const region of document.querySelectorAll(WIDE)) {
    const wide = region.scrollWidth > region.clientWidth + 1;
    const high = region.scrollHeight > region.clientHeight + 1;
    if ((wide || high) && /auto|scroll/.test(getComputedStyle(region).overflow)) region.tabIndex = 0;
    else region.removeAttribute("tabindex");
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
"""
_component = st.components.v2.component("jointid_scroll_regions", html="<i hidden></i>", js=_JS)


def make_scroll_regions_focusable() -> None:
    """Give every region that scrolls a place in the order of the tab key."""
    _component(key="scroll_regions")
