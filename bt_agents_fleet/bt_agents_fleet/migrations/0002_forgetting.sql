-- SPDX-License-Identifier: Apache-2.0
-- Steps of the event 'forget': no step of the agent that was made before, in a layer of that hash,
-- is here any more. Programs that do not know them would keep what was forgotten.

CREATE INDEX step_that_forgets ON step (agent) WHERE event = 'forget';
