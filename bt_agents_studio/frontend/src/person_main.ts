// SPDX-License-Identifier: Apache-2.0
// Entry point of the page Person, its own document, so a tablet loads neither tree nor plots.

import { load } from "./start";

load(() => import("./person_application"));
