/* The page for an address without a token: a tab that was reloaded continues with the token that it had. */

import { savedQuery } from "./token.js";

const query = savedQuery();
if (query) location.replace(location.pathname + query);
