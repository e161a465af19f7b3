// SPDX-License-Identifier: Apache-2.0
// Entry point of all pages except Person.

import { load } from "./start";

load(() => import("./application"));
