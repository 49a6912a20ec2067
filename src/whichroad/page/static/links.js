// Links to a moment, such as `#t=310&z=17`: seconds from the beginning, zoom as of web maps.

/** What the address names: {t, z}, each null where it is not there. */
export function linked() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const [t, z] = ["t", "z"].map((name) => Number.parseFloat(asked.get(name)));
  return { t: Number.isNaN(t) ? null : t, z: Number.isNaN(z) ? null : z };
}

/** Puts a link to a moment (null: to none) into the address and the clipboard; gives what to tell. */
export async function copyLink(t, z) {
  const link = new URL(location.href);
  link.searchParams.delete("token");
  link.hash = `${t === null ? "" : `t=${t.toFixed(1)}&`}z=${z.toFixed(1)}`;
  history.replaceState(history.state, "", link.href);
  const copied = await navigator.clipboard?.writeText(link.href).then(() => true, () => false);
  return copied ? "link copied" : "the address is the link";
}
