// SPDX-License-Identifier: Apache-2.0
// Start of the page Person, which has a document of its own: a tablet loads no tree and no plots.

import { load } from "./start";

load(() => import("./person_application"));
