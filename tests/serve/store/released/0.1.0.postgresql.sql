CREATE TABLE public.buildings (
    number integer NOT NULL,
    name character varying NOT NULL
);
CREATE SEQUENCE public.buildings_number_seq
    AS integer
    START WITH 1
    INCREMENT BY 1
    NO MINVALUE
    NO MAXVALUE
    CACHE 1;
ALTER SEQUENCE public.buildings_number_seq OWNED BY public.buildings.number;
CREATE TABLE public.floor_parts (
    floor integer NOT NULL,
    sha256 character varying NOT NULL,
    size_bytes bigint NOT NULL
);
CREATE TABLE public.floor_points (
    bssid bigint NOT NULL,
    floor integer NOT NULL,
    level_dbm real NOT NULL,
    spread_db real NOT NULL,
    share real NOT NULL
);
CREATE TABLE public.floors (
    number integer NOT NULL,
    id character varying NOT NULL,
    building integer NOT NULL,
    level integer NOT NULL,
    latitude_deg double precision NOT NULL,
    longitude_deg double precision NOT NULL,
    radius_m double precision NOT NULL,
    altitude_m double precision,
    has_wifi boolean NOT NULL,
    revision bigint NOT NULL,
    manifest text NOT NULL,
    published_utc timestamp with time zone NOT NULL
);
CREATE SEQUENCE public.floors_number_seq
    AS integer
    START WITH 1
    INCREMENT BY 1
    NO MINVALUE
    NO MAXVALUE
    CACHE 1;
ALTER SEQUENCE public.floors_number_seq OWNED BY public.floors.number;
CREATE TABLE public.job_files (
    job_id character varying NOT NULL,
    name character varying NOT NULL,
    sha256 character varying NOT NULL,
    size_bytes bigint NOT NULL
);
CREATE TABLE public.jobs (
    id character varying NOT NULL,
    user_id character varying NOT NULL,
    kind character varying NOT NULL,
    state character varying NOT NULL,
    given json NOT NULL,
    gave json NOT NULL,
    doing character varying NOT NULL,
    share double precision,
    attempts integer NOT NULL,
    claim character varying,
    problem character varying,
    created_utc timestamp with time zone NOT NULL,
    started_utc timestamp with time zone,
    finished_utc timestamp with time zone
);
CREATE TABLE public.map_files (
    map_id character varying NOT NULL,
    name character varying NOT NULL,
    sha256 character varying NOT NULL,
    size_bytes bigint NOT NULL
);
CREATE TABLE public.map_packages (
    map_id character varying NOT NULL,
    sources_sha256 character varying NOT NULL,
    revision bigint NOT NULL,
    manifest character varying NOT NULL
);
CREATE TABLE public.map_parts (
    map_id character varying NOT NULL,
    sha256 character varying NOT NULL,
    size_bytes bigint NOT NULL
);
CREATE TABLE public.maps (
    id character varying NOT NULL,
    user_id character varying NOT NULL,
    name character varying NOT NULL,
    kind character varying NOT NULL,
    sources json NOT NULL,
    facts json NOT NULL,
    floor_plan json,
    created_utc timestamp with time zone NOT NULL
);
CREATE TABLE public.recording_files (
    recording_id character varying NOT NULL,
    name character varying NOT NULL,
    sha256 character varying NOT NULL,
    size_bytes bigint NOT NULL
);
CREATE TABLE public.recordings (
    id character varying NOT NULL,
    user_id character varying NOT NULL,
    name character varying NOT NULL,
    device character varying NOT NULL,
    state character varying NOT NULL,
    refusal character varying,
    facts json NOT NULL,
    created_utc timestamp with time zone NOT NULL
);
CREATE TABLE public.uploads (
    id character varying NOT NULL,
    user_id character varying NOT NULL,
    recording_id character varying,
    file_name character varying NOT NULL,
    length_bytes bigint,
    wants_map boolean NOT NULL,
    finished boolean NOT NULL,
    created_utc timestamp with time zone NOT NULL
);
CREATE TABLE public.users (
    id character varying NOT NULL,
    name character varying NOT NULL,
    token_sha256 character varying NOT NULL,
    is_owner boolean NOT NULL,
    created_utc timestamp with time zone NOT NULL
);
ALTER TABLE ONLY public.buildings ALTER COLUMN number SET DEFAULT nextval('public.buildings_number_seq'::regclass);
ALTER TABLE ONLY public.floors ALTER COLUMN number SET DEFAULT nextval('public.floors_number_seq'::regclass);
INSERT INTO public.buildings VALUES (1, 'North Mall');
INSERT INTO public.floor_parts VALUES (1, '9999999999999999999999999999999999999999999999999999999999999999', 4);
INSERT INTO public.floor_points VALUES (4619388321792, 1, -60.5, 2, 0.5);
INSERT INTO public.floors VALUES (1, '88888888888888888888888888888888', 1, 2, 47.3769, 8.5417, 20, NULL, true, 1, '{}', '2026-11-22 06:45:06+00');
INSERT INTO public.job_files VALUES ('66666666666666666666666666666666', 'fixes.csv', 'dddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddd', 5);
INSERT INTO public.jobs VALUES ('66666666666666666666666666666666', '11111111111111111111111111111111', 'map', 'done', '{"recording": "33333333333333333333333333333333"}', '{"map": "77777777777777777777777777777777"}', '', 1, 1, NULL, NULL, '2026-11-22 06:45:06+00', '2026-11-22 06:45:06+00', '2026-11-22 06:45:06+00');
INSERT INTO public.map_files VALUES ('77777777777777777777777777777777', 'map.npz', 'eeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeeee', 6);
INSERT INTO public.map_packages VALUES ('77777777777777777777777777777777', 'ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff', 1763793906, '{}');
INSERT INTO public.map_parts VALUES ('77777777777777777777777777777777', '0000000000000000000000000000000000000000000000000000000000000000', 8);
INSERT INTO public.maps VALUES ('77777777777777777777777777777777', '11111111111111111111111111111111', 'Hall', 'run', '["33333333333333333333333333333333"]', '{"walks": 1}', NULL, '2026-11-22 06:45:06+00');
INSERT INTO public.recording_files VALUES ('33333333333333333333333333333333', 'audio.flac', 'cccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccc', 8589934592);
INSERT INTO public.recordings VALUES ('33333333333333333333333333333333', '11111111111111111111111111111111', 'round the table', 'test phone', 'ready', NULL, '{"duration_s": 12.5, "bytes": 7}', '2026-11-22 06:45:06+00');
INSERT INTO public.recordings VALUES ('44444444444444444444444444444444', '22222222222222222222222222222222', 'it''s "broken"', 'unknown', 'refused', 'audio.flac: is cut off', '{}', '2026-11-22 06:45:06+00');
INSERT INTO public.uploads VALUES ('55555555555555555555555555555555', '22222222222222222222222222222222', '44444444444444444444444444444444', 'wifi.csv', 9, true, false, '2026-11-22 06:45:06+00');
INSERT INTO public.users VALUES ('11111111111111111111111111111111', 'owner', 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', true, '2026-11-22 06:45:06+00');
INSERT INTO public.users VALUES ('22222222222222222222222222222222', 'Zoë 🦇', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', false, '2026-11-22 06:45:06+00');
SELECT pg_catalog.setval('public.buildings_number_seq', 1, true);
SELECT pg_catalog.setval('public.floors_number_seq', 1, true);
ALTER TABLE ONLY public.buildings
    ADD CONSTRAINT buildings_name_key UNIQUE (name);
ALTER TABLE ONLY public.buildings
    ADD CONSTRAINT buildings_pkey PRIMARY KEY (number);
ALTER TABLE ONLY public.floor_parts
    ADD CONSTRAINT floor_parts_pkey PRIMARY KEY (floor, sha256);
ALTER TABLE ONLY public.floor_points
    ADD CONSTRAINT floor_points_pkey PRIMARY KEY (bssid, floor);
ALTER TABLE ONLY public.floors
    ADD CONSTRAINT floors_building_level_key UNIQUE (building, level);
ALTER TABLE ONLY public.floors
    ADD CONSTRAINT floors_id_key UNIQUE (id);
ALTER TABLE ONLY public.floors
    ADD CONSTRAINT floors_pkey PRIMARY KEY (number);
ALTER TABLE ONLY public.job_files
    ADD CONSTRAINT job_files_pkey PRIMARY KEY (job_id, name);
ALTER TABLE ONLY public.jobs
    ADD CONSTRAINT jobs_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.map_files
    ADD CONSTRAINT map_files_pkey PRIMARY KEY (map_id, name);
ALTER TABLE ONLY public.map_packages
    ADD CONSTRAINT map_packages_pkey PRIMARY KEY (map_id);
ALTER TABLE ONLY public.map_parts
    ADD CONSTRAINT map_parts_pkey PRIMARY KEY (map_id, sha256);
ALTER TABLE ONLY public.maps
    ADD CONSTRAINT maps_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.recording_files
    ADD CONSTRAINT recording_files_pkey PRIMARY KEY (recording_id, name);
ALTER TABLE ONLY public.recordings
    ADD CONSTRAINT recordings_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.uploads
    ADD CONSTRAINT uploads_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.users
    ADD CONSTRAINT users_pkey PRIMARY KEY (id);
CREATE INDEX floors_by_place ON public.floors USING btree (latitude_deg, longitude_deg);
CREATE INDEX ix_floor_parts_sha256 ON public.floor_parts USING btree (sha256);
CREATE INDEX ix_floor_points_floor ON public.floor_points USING btree (floor);
CREATE INDEX ix_job_files_sha256 ON public.job_files USING btree (sha256);
CREATE INDEX ix_jobs_state ON public.jobs USING btree (state);
CREATE INDEX ix_jobs_user_id ON public.jobs USING btree (user_id);
CREATE INDEX ix_map_files_sha256 ON public.map_files USING btree (sha256);
CREATE INDEX ix_map_parts_sha256 ON public.map_parts USING btree (sha256);
CREATE INDEX ix_maps_user_id ON public.maps USING btree (user_id);
CREATE INDEX ix_recording_files_sha256 ON public.recording_files USING btree (sha256);
CREATE INDEX ix_recordings_user_id ON public.recordings USING btree (user_id);
CREATE INDEX ix_uploads_recording_id ON public.uploads USING btree (recording_id);
CREATE INDEX ix_uploads_user_id ON public.uploads USING btree (user_id);
CREATE UNIQUE INDEX ix_users_token_sha256 ON public.users USING btree (token_sha256);
ALTER TABLE ONLY public.floor_parts
    ADD CONSTRAINT floor_parts_floor_fkey FOREIGN KEY (floor) REFERENCES public.floors(number) ON DELETE CASCADE;
ALTER TABLE ONLY public.floor_points
    ADD CONSTRAINT floor_points_floor_fkey FOREIGN KEY (floor) REFERENCES public.floors(number) ON DELETE CASCADE;
ALTER TABLE ONLY public.floors
    ADD CONSTRAINT floors_building_fkey FOREIGN KEY (building) REFERENCES public.buildings(number);
ALTER TABLE ONLY public.job_files
    ADD CONSTRAINT job_files_job_id_fkey FOREIGN KEY (job_id) REFERENCES public.jobs(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.jobs
    ADD CONSTRAINT jobs_user_id_fkey FOREIGN KEY (user_id) REFERENCES public.users(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.map_files
    ADD CONSTRAINT map_files_map_id_fkey FOREIGN KEY (map_id) REFERENCES public.maps(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.map_packages
    ADD CONSTRAINT map_packages_map_id_fkey FOREIGN KEY (map_id) REFERENCES public.maps(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.map_parts
    ADD CONSTRAINT map_parts_map_id_fkey FOREIGN KEY (map_id) REFERENCES public.maps(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.maps
    ADD CONSTRAINT maps_user_id_fkey FOREIGN KEY (user_id) REFERENCES public.users(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.recording_files
    ADD CONSTRAINT recording_files_recording_id_fkey FOREIGN KEY (recording_id) REFERENCES public.recordings(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.recordings
    ADD CONSTRAINT recordings_user_id_fkey FOREIGN KEY (user_id) REFERENCES public.users(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.uploads
    ADD CONSTRAINT uploads_recording_id_fkey FOREIGN KEY (recording_id) REFERENCES public.recordings(id) ON DELETE CASCADE;
ALTER TABLE ONLY public.uploads
    ADD CONSTRAINT uploads_user_id_fkey FOREIGN KEY (user_id) REFERENCES public.users(id) ON DELETE CASCADE;
