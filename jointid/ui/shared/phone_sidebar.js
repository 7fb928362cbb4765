// On a phone, the sidebar covers the page: it closes once a page is chosen.
const NARROW = 768;
const LINK = "[data-testid=stSidebar] [data-testid=stPageLink]";

function close(event) {
  if (innerWidth >= NARROW || !event.target.closest(LINK)) return;
  document.querySelector("[data-testid=stSidebarCollapseButton] button")?.click();
}

export default function () {
  document.addEventListener("click", close);
  return () => document.removeEventListener("click", close);
}
