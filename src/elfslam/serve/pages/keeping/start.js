/** Keeps the phone page as soon as it is there; `data-offline` of the page says how that went. */

import { keepPage } from "./offline.js";

const isIdle = () => document.getElementById("start")?.hidden === false;

const { isKept, why } = await keepPage(isIdle);
document.documentElement.dataset.offline = isKept ? "kept" : why;
