/** Why a map is not taken, in one line each. What the phone held before stays as it was. */

import { t } from "../shared/words.js";

export const NO_KEY = t("This phone does not know the server's key yet. Scan the code that the server shows, once more.");
export const WRONG_KEY = t("The server's key is not the one of the code that this phone scanned. The map was not taken.");
export const WRONG_SIGNATURE = t("The map is not signed by the server's key. It was not taken.");
export const OTHER_MAP = t("The server sent another map than the one that was asked for. It was not taken.");
export const OLDER = t("The server sent an older state of the map than this phone has. It was not taken.");
export const UNKNOWN_FORMAT =
  t("The map is in another format than this page reads. Reload the page while the server is there, and fetch the map again.");
export const WRONG_PART = t("A part of the map is not what the server signed. The map was not taken; try again.");
export const NOT_HERE = t("This map is not on this phone. Fetch it while the server is there.");
export const DAMAGED = t("What this phone kept of the map is damaged. Fetch it again while the server is there.");
