// Light, dark, or as the system says; remembered where the browser allows that.

const ORDER = ["auto", "light", "dark"];
const NAMES = { auto: "Automatic", light: "Light", dark: "Dark" };
const KEY = "perfcap-theme";

/** Wire the button; `onChange` is called after every change, the system's too. */
export function setUpTheme(button, name, onChange) {
  let theme = remembered();
  const apply = () => {
    document.documentElement.dataset.theme = theme;
    name.textContent = NAMES[theme];
    onChange();
  };
  button.addEventListener("click", () => {
    theme = ORDER[(ORDER.indexOf(theme) + 1) % ORDER.length];
    remember(theme);
    apply();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", onChange);
  apply();
}

function remembered() {
  try {
    const theme = localStorage.getItem(KEY);
    return ORDER.includes(theme) ? theme : "auto";
  } catch {
    return "auto"; // pages from disk may have no storage
  }
}

function remember(theme) {
  try {
    localStorage.setItem(KEY, theme);
  } catch {
    // it holds until the page is closed
  }
}
