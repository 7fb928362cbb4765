// On a phone, the sidebar covers the page: it closes once a page is chosen, and after F5.
const NARROW = 768;
const LINK = "[data-testid=stSidebar] [data-testid=stPageLink]";
const KEPT = "stSidebarCollapsed-";

function close(event) {
  if (innerWidth >= NARROW || !event.target.closest(LINK)) return;
  document.querySelector("[data-testid=stSidebarCollapseButton] button")?.click();
  setTimeout(forget, 300);
}

function leave() {
  if (innerWidth < NARROW) forget();
}

// Streamlit remembers whether it was open; each window should begin with what suits its width.
function forget() {
  try {
    for (const key of Object.keys(localStorage)) if (key.startsWith(KEPT)) localStorage.removeItem(key);
  } catch {
    // A browser may forbid storage: then nothing was remembered.
  }
}

export default function () {
  document.addEventListener("click", close);
  addEventListener("pagehide", leave);
  return () => {
    document.removeEventListener("click", close);
    removeEventListener("pagehide", leave);
  };
}
