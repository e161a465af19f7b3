// SPDX-License-Identifier: Apache-2.0
// Start of all pages but Person.

import { load } from "./start";

load(() => import("./application"));
