/* The page for an address without a token. A tab that was reloaded continues with the token that it has saved. */

import { savedQuery } from "./token.js";

const query = savedQuery();
if (query) location.replace(location.pathname + query);
