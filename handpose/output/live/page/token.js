/* The query of the page's address contains the token of the server. It is removed from the address bar, where others
   could read it, and kept in the storage of the tab for a reload. */

const KEY = "query";

export function takeQuery() {
  const query = location.search;
  try {
    sessionStorage.setItem(KEY, query);
  } catch {} // without storage, a reload needs the address again
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
