BEGIN TRANSACTION;
CREATE TABLE buildings (
	number INTEGER NOT NULL, 
	name VARCHAR NOT NULL, 
	PRIMARY KEY (number), 
	UNIQUE (name)
);
INSERT INTO "buildings" VALUES(1,'North Mall');
CREATE TABLE floor_parts (
	floor INTEGER NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	size_bytes BIGINT NOT NULL, 
	PRIMARY KEY (floor, sha256), 
	FOREIGN KEY(floor) REFERENCES floors (number) ON DELETE CASCADE
);
INSERT INTO "floor_parts" VALUES(1,'9999999999999999999999999999999999999999999999999999999999999999',4);
CREATE TABLE floor_points (
	bssid BIGINT NOT NULL, 
	floor INTEGER NOT NULL, 
	level_dbm REAL NOT NULL, 
	spread_db REAL NOT NULL, 
	share REAL NOT NULL, 
	PRIMARY KEY (bssid, floor), 
	FOREIGN KEY(floor) REFERENCES floors (number) ON DELETE CASCADE
);
INSERT INTO "floor_points" VALUES(4619388321792,1,-60.5,2.0,0.5);
CREATE TABLE floors (
	number INTEGER NOT NULL, 
	id VARCHAR NOT NULL, 
	building INTEGER NOT NULL, 
	level INTEGER NOT NULL, 
	latitude_deg DOUBLE NOT NULL, 
	longitude_deg DOUBLE NOT NULL, 
	radius_m DOUBLE NOT NULL, 
	altitude_m DOUBLE, 
	has_wifi BOOLEAN NOT NULL, 
	revision BIGINT NOT NULL, 
	manifest TEXT NOT NULL, 
	published_utc DATETIME NOT NULL, 
	PRIMARY KEY (number), 
	UNIQUE (building, level), 
	UNIQUE (id), 
	FOREIGN KEY(building) REFERENCES buildings (number)
);
INSERT INTO "floors" VALUES(1,'88888888888888888888888888888888',1,2,47.3769,8.5417,20.0,NULL,1,1,'{}','2026-11-22 06:45:06.000000');
CREATE TABLE job_files (
	job_id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	size_bytes BIGINT NOT NULL, 
	PRIMARY KEY (job_id, name), 
	FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "job_files" VALUES('66666666666666666666666666666666','fixes.csv','dddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddd',5);
CREATE TABLE jobs (
	id VARCHAR NOT NULL, 
	user_id VARCHAR NOT NULL, 
	kind VARCHAR NOT NULL, 
	state VARCHAR NOT NULL, 
	given JSON NOT NULL, 
	gave JSON NOT NULL, 
	doing VARCHAR NOT NULL, 
	share DOUBLE, 
	attempts INTEGER NOT NULL, 
	claim VARCHAR, 
	problem VARCHAR, 
	created_utc DATETIME NOT NULL, 
	started_utc DATETIME, 
	finished_utc DATETIME, 
	PRIMARY KEY (id), 
	FOREIGN KEY(user_id) REFERENCES users (id) ON DELETE CASCADE
);
INSERT INTO "jobs" VALUES('66666666666666666666666666666666','11111111111111111111111111111111','map','done','{"recording": "33333333333333333333333333333333"}','{"map": "77777777777777777777777777777777"}','',1.0,1,NULL,NULL,'2026-11-22 06:45:06.000000','2026-11-22 06:45:06.000000','2026-11-22 06:45:06.000000');
CREATE TABLE map_files (
	map_id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	size_bytes BIGINT NOT NULL, 
	PRIMARY KEY (map_id, name), 
	FOREIGN KEY(map_id) REFERENCES maps (id) ON DELETE CASCADE
);
INSERT INTO "map_files" VALUES('77777777777777777777777777777777','map.npz','eeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeee',6);
CREATE TABLE map_packages (
	map_id VARCHAR NOT NULL, 
	sources_sha256 VARCHAR NOT NULL, 
	revision BIGINT NOT NULL, 
	manifest VARCHAR NOT NULL, 
	PRIMARY KEY (map_id), 
	FOREIGN KEY(map_id) REFERENCES maps (id) ON DELETE CASCADE
);
INSERT INTO "map_packages" VALUES('77777777777777777777777777777777','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff',1763793906,'{}');
CREATE TABLE map_parts (
	map_id VARCHAR NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	size_bytes BIGINT NOT NULL, 
	PRIMARY KEY (map_id, sha256), 
	FOREIGN KEY(map_id) REFERENCES maps (id) ON DELETE CASCADE
);
INSERT INTO "map_parts" VALUES('77777777777777777777777777777777','0000000000000000000000000000000000000000000000000000000000000000',8);
CREATE TABLE maps (
	id VARCHAR NOT NULL, 
	user_id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	kind VARCHAR NOT NULL, 
	sources JSON NOT NULL, 
	facts JSON NOT NULL, 
	floor_plan JSON, 
	created_utc DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(user_id) REFERENCES users (id) ON DELETE CASCADE
);
INSERT INTO "maps" VALUES('77777777777777777777777777777777','11111111111111111111111111111111','Hall','run','["33333333333333333333333333333333"]','{"walks": 1}',NULL,'2026-11-22 06:45:06.000000');
CREATE TABLE recording_files (
	recording_id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	size_bytes BIGINT NOT NULL, 
	PRIMARY KEY (recording_id, name), 
	FOREIGN KEY(recording_id) REFERENCES recordings (id) ON DELETE CASCADE
);
INSERT INTO "recording_files" VALUES('33333333333333333333333333333333','audio.flac','cccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccc',8589934592);
CREATE TABLE recordings (
	id VARCHAR NOT NULL, 
	user_id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	device VARCHAR NOT NULL, 
	state VARCHAR NOT NULL, 
	refusal VARCHAR, 
	facts JSON NOT NULL, 
	created_utc DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(user_id) REFERENCES users (id) ON DELETE CASCADE
);
INSERT INTO "recordings" VALUES('33333333333333333333333333333333','11111111111111111111111111111111','round the table','test phone','ready',NULL,'{"duration_s": 12.5, "bytes": 7}','2026-11-22 06:45:06.000000');
INSERT INTO "recordings" VALUES('44444444444444444444444444444444','22222222222222222222222222222222','it''s "broken"','unknown','refused','audio.flac: is cut off','{}','2026-11-22 06:45:06.000000');
CREATE TABLE uploads (
	id VARCHAR NOT NULL, 
	user_id VARCHAR NOT NULL, 
	recording_id VARCHAR, 
	file_name VARCHAR NOT NULL, 
	length_bytes BIGINT, 
	wants_map BOOLEAN NOT NULL, 
	finished BOOLEAN NOT NULL, 
	created_utc DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(user_id) REFERENCES users (id) ON DELETE CASCADE, 
	FOREIGN KEY(recording_id) REFERENCES recordings (id) ON DELETE CASCADE
);
INSERT INTO "uploads" VALUES('55555555555555555555555555555555','22222222222222222222222222222222','44444444444444444444444444444444','wifi.csv',9,1,0,'2026-11-22 06:45:06.000000');
CREATE TABLE users (
	id VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	token_sha256 VARCHAR NOT NULL, 
	is_owner BOOLEAN NOT NULL, 
	created_utc DATETIME NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "users" VALUES('11111111111111111111111111111111','owner','aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',1,'2026-11-22 06:45:06.000000');
INSERT INTO "users" VALUES('22222222222222222222222222222222','Zoë 🦇','bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb',0,'2026-11-22 06:45:06.000000');
CREATE UNIQUE INDEX ix_users_token_sha256 ON users (token_sha256);
CREATE INDEX ix_recordings_user_id ON recordings (user_id);
CREATE INDEX ix_jobs_user_id ON jobs (user_id);
CREATE INDEX ix_jobs_state ON jobs (state);
CREATE INDEX ix_maps_user_id ON maps (user_id);
CREATE INDEX floors_by_place ON floors (latitude_deg, longitude_deg);
CREATE INDEX ix_recording_files_sha256 ON recording_files (sha256);
CREATE INDEX ix_uploads_user_id ON uploads (user_id);
CREATE INDEX ix_uploads_recording_id ON uploads (recording_id);
CREATE INDEX ix_job_files_sha256 ON job_files (sha256);
CREATE INDEX ix_map_files_sha256 ON map_files (sha256);
CREATE INDEX ix_map_parts_sha256 ON map_parts (sha256);
CREATE INDEX ix_floor_parts_sha256 ON floor_parts (sha256);
CREATE INDEX ix_floor_points_floor ON floor_points (floor);
COMMIT;
