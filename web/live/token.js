/* The query of the page's address, with its token. It leaves the address bar, where others could read it; the tab keeps
   it for a reload. */

const KEY = "query";

export function takeQuery() {
  const query = location.search;
  try {
    sessionStorage.setItem(KEY, query);
  } catch {} // storage is disabled: a reload needs the address again
  history.replaceState(null, "", location.pathname);
  return query;
}

export function savedQuery() {
  try {
    return sessionStorage.getItem(KEY);
  } catch {
    return null;
  }
}
