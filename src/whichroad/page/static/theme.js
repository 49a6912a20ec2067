// Before anything is painted: the theme that was chosen here, else the system's.
(() => {
  let kept = null;
  try {
    kept = localStorage.getItem("whichroad-theme");
  } catch {
    // storage is refused: the system decides
  }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = kept ?? (dark ? "dark" : "light");
})();
