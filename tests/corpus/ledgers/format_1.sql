-- SPDX-License-Identifier: Apache-2.0
-- A ledger as the program wrote it in format 1.
PRAGMA application_id = 1651794279;
PRAGMA user_version = 1;
BEGIN TRANSACTION;
CREATE TABLE revision (
    agent TEXT NOT NULL,
    revision INTEGER NOT NULL,
    profile TEXT NOT NULL,
    cause TEXT NOT NULL,
    kind INTEGER NOT NULL,
    source TEXT NOT NULL,
    reason TEXT NOT NULL,
    feedback_id TEXT UNIQUE,
    epoch TEXT NOT NULL,
    round INTEGER NOT NULL,
    rate REAL NOT NULL,
    target TEXT NOT NULL,
    scene_id TEXT NOT NULL,
    cancels INTEGER NOT NULL,
    restores INTEGER,
    stamp REAL NOT NULL,
    PRIMARY KEY (agent, revision)
) WITHOUT ROWID
;
INSERT INTO "revision" VALUES('express',0,'{"age": 2.0, "mood": 3.0}','authored',0,'file','first seen',NULL,'',0,0.0,'{"age": 2.0, "mood": 3.0}','',0,NULL,1700000003.0);
INSERT INTO "revision" VALUES('express',1,'{"age": 2.5, "mood": 3.0}','authored',0,'file','the author changed age',NULL,'',0,0.0,'{"age": 2.5, "mood": 3.0}','',0,NULL,1700000012.0);
INSERT INTO "revision" VALUES('guide',0,'{"age": 4.0, "mood": 3.0}','authored',0,'file','first seen',NULL,'',0,0.0,'{"age": 4.0, "mood": 3.0}','',0,NULL,1700000001.5);
INSERT INTO "revision" VALUES('guide',1,'{"age": 4.2, "mood": 0.30000000000000004}','feedback',0,'button','zu laut “ä”','f1','e1',3,0.2,'{"age": 5.0}','s1',1,NULL,1700000004.5);
INSERT INTO "revision" VALUES('guide',2,'{"age": 4.0, "mood": 3.0}','feedback',2,'mood rule','x','rule/e1/4/guide/0','e1',4,0.2,'{"age": 4.4, "mood": 3.0}','s2',0,NULL,1700000006.0);
INSERT INTO "revision" VALUES('guide',3,'{"age": 1.0, "mood": 3.0}','feedback',3,'tuning','','tuning/1','',0,1.0,'{"age": 1.0}','',0,NULL,1700000007.5);
INSERT INTO "revision" VALUES('guide',4,'{"age": 4.0, "mood": 3.0}','undo',0,'studio','wrong',NULL,'',0,0.0,'{}','',0,2,1700000009.0);
INSERT INTO "revision" VALUES('guide',5,'{"age": 4.2, "mood": 0.30000000000000004}','undo',0,'','undoes revision 2',NULL,'',0,0.0,'{}','',0,1,1700000010.5);
CREATE TRIGGER revision_no_UPDATE BEFORE UPDATE ON revision
BEGIN SELECT RAISE(ABORT, 'revisions are never changed; append a new one'); END;
CREATE TRIGGER revision_no_DELETE BEFORE DELETE ON revision
BEGIN SELECT RAISE(ABORT, 'revisions are never changed; append a new one'); END;
COMMIT;
