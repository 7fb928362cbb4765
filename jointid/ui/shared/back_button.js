// One step of the Back button for each page. Streamlit first pushes the next page's parameters with the
// old page's path: that step would show the old page without what was typed there.
const LINK = "[data-testid=stPageLink-NavLink]";

export default function () {
  if (window.jointidPush) return;
  let wanted;
  const push = (window.jointidPush = history.pushState.bind(history));
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.(LINK);
    if (link && !event.ctrlKey && !event.metaKey && !event.shiftKey) wanted = new URL(link.href).pathname;
  }, true);
  addEventListener("popstate", () => { wanted = undefined; });
  history.pushState = (state, unused, url) => {
    const { pathname } = new URL(url, location.href);
    if (wanted !== undefined && pathname === location.pathname && pathname !== wanted) return;
    wanted = undefined;
    push(state, unused, url);
  };
}
