-- SPDX-License-Identifier: Apache-2.0
-- The robots of a fleet, each with how far its ledger is here, and the steps that they have made.

CREATE TABLE robot (
    robot text PRIMARY KEY CHECK (robot ~ '^[a-z0-9][a-z0-9_-]{0,62}$'),
    ledger bigint UNIQUE,  -- what tells its ledger from others, once it has pushed
    position bigint NOT NULL DEFAULT 0,  -- number of the last row of its ledger that is covered
    checksum bigint NOT NULL DEFAULT 0,  -- of that row
    shares text NOT NULL DEFAULT '{}' CHECK (length(shares) <= 300000),
    joined timestamptz NOT NULL DEFAULT now(),
    seen timestamptz NOT NULL DEFAULT now()
);

CREATE TABLE step (
    robot text NOT NULL REFERENCES robot,
    number bigint NOT NULL CHECK (number > 0),
    arrival bigserial NOT NULL UNIQUE,  -- in the order of commits, as one robot writes at a time
    agent text NOT NULL CONSTRAINT step_agent_is_short CHECK (length(agent) <= 200),
    layer text NOT NULL CONSTRAINT step_layer_is_short CHECK (length(layer) <= 256),
    base text NOT NULL,
    event text NOT NULL,
    kind smallint NOT NULL,
    target jsonb NOT NULL CONSTRAINT step_target_is_short CHECK (length(target::text) <= 8192),
    weight double precision NOT NULL,
    changes bigint NOT NULL,
    stamp double precision NOT NULL,
    PRIMARY KEY (robot, number)
);

CREATE INDEX step_by_agent ON step (agent, base, arrival);
