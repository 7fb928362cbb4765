// On a phone, the sidebar covers the page: it closes once a page is chosen.
const NARROW = 768;
const LINK = "[data-testid=stSidebar] [data-testid=stPageLink]";
const KEPT = "stSidebarCollapsed-";

function close(event) {
  if (innerWidth >= NARROW || !event.target.closest(LINK)) return;
  document.querySelector("[data-testid=stSidebarCollapseButton] button")?.click();
  setTimeout(forget, 300);
}

// Streamlit remembers a closed sidebar; a wide window should show it again.
function forget() {
  try {
    for (const key of Object.keys(localStorage)) if (key.startsWith(KEPT)) localStorage.removeItem(key);
  } catch {
    // A browser may forbid storage: then nothing was remembered.
  }
}

export default function () {
  document.addEventListener("click", close);
  return () => document.removeEventListener("click", close);
}
