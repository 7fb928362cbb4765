const KEY = "jointid workspace";

export default function ({ parentElement, data }) {
  const link = parentElement.querySelector("a");
  link.hidden = true;
  try {
    if (data.current) return localStorage.setItem(KEY, `w=${data.current}&study=${data.study}`);
    const last = localStorage.getItem(KEY) ?? "";
    if (data.unknown && last.includes(data.unknown)) return localStorage.removeItem(KEY);
    if (!/^w=[A-Za-z0-9_-]{32}&study=/.test(last)) return;
    link.href = `?${last}`;
    link.hidden = false;
  } catch {
    // A browser may forbid storage: then there is no way back but the full address.
  }
}
