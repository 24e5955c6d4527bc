//! Log files of other programs, made by their own writers, against what their own Python readers say is in them (golden/log_files).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use deadtime::log::{ReadOptions, Recording, open};
use serde::Deserialize;

use crate::support::program::{Folder, deadtime, text};

/// Nanoseconds as seconds.
const TIME_TOLERANCE_S: f64 = 1e-9;

#[derive(Deserialize)]
struct Expected {
    time: Vec<f64>,
    channels: BTreeMap<String, Vec<Option<f64>>>,
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/log_files").join(name)
}

fn expected() -> BTreeMap<String, BTreeMap<String, Expected>> {
    serde_json::from_slice(&std::fs::read(golden("expected.json")).unwrap()).unwrap()
}

fn read(path: &Path) -> Recording {
    open(path, &ReadOptions::default()).unwrap()
}

/// Value for value; channels that hold nothing are left out on our side.
fn compare(file: &str, topics: &BTreeMap<String, Expected>) {
    let recording = read(&golden(file));
    let names: Vec<&str> = recording.topics.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names.len(), topics.len(), "{file}: {names:?}");
    for (name, expected) in topics {
        let log = &recording
            .topics
            .iter()
            .find(|t| t.name == *name)
            .unwrap_or_else(|| panic!("{file}: no {name} in {names:?}"))
            .log;
        assert_eq!(log.len(), expected.time.len(), "{file} {name}");
        for (a, b) in log.time_s().iter().zip(&expected.time) {
            assert!((a - b).abs() <= TIME_TOLERANCE_S, "{file} {name}: {a} and {b}");
        }
        let ours: Vec<&str> = log.names().collect();
        assert_eq!(ours.len(), expected.channels.len(), "{file} {name}: {ours:?}");
        for (channel, values) in &expected.channels {
            let samples = log.channel(channel).unwrap_or_else(|e| panic!("{e}")).samples();
            let found: Vec<Option<f64>> = (0..log.len()).map(|k| samples.get(k)).collect();
            assert_eq!(&found, values, "{file} {name}.{channel}");
        }
    }
}

/// HDF5, Parquet and Arrow are read where the program was built with them.
fn readable(file: &str) -> bool {
    let tables = ["snappy.parquet", "zstd.parquet", "data.arrow", "lz4.feather"];
    cfg!(feature = "tables") || !(tables.contains(&file) || file.ends_with("v73.mat"))
}

#[test]
fn every_file_holds_what_its_own_reader_says() {
    let expected = expected();
    assert_eq!(
        expected.keys().filter(|file| readable(file)).count(),
        if cfg!(feature = "tables") { 22 } else { 14 }
    );
    for (file, topics) in expected.iter().filter(|(file, _)| readable(file)) {
        compare(file, topics);
    }
}

#[cfg(not(feature = "tables"))]
#[test]
fn a_format_that_is_not_read_is_named_with_a_remedy() {
    for file in expected().keys().filter(|file| !readable(file)) {
        let run = deadtime(&["log", text(&golden(file))]);
        run.refused(&[file, "recognised but not read"]);
    }
}

#[test]
fn a_file_cut_off_anywhere_is_read_up_to_there_or_refused() {
    let folder = Folder::new();
    for file in expected().keys().filter(|file| readable(file)) {
        let whole = std::fs::read(golden(file)).unwrap();
        let full: usize = read(&golden(file)).topics.iter().map(|t| t.log.len()).sum();
        // Every byte of small files, every so many of larger ones.
        let step = whole.len() / 400 + 1;
        let mut before = 0;
        for length in (0..whole.len()).step_by(step) {
            let path = folder.write_bytes(file, &whole[..length]);
            match open(&path, &ReadOptions::default()) {
                Ok(recording) => {
                    let rows: usize = recording.topics.iter().map(|t| t.log.len()).sum();
                    assert!(rows <= full, "{file} at {length}");
                    if file.ends_with(".ulg") || file.ends_with(".mcap") {
                        assert!(rows >= before, "{file} at {length}: fewer rows of more bytes");
                        // Nothing tells a ULog that ends between two messages from a whole one.
                        assert!(
                            rows == full
                                || file.ends_with(".ulg")
                                || recording.notes.iter().any(|n| n.contains("cut off")),
                            "{file} at {length}: {:?}",
                            recording.notes
                        );
                        before = rows;
                    }
                }
                Err(error) => assert!(error.to_string().contains(file.as_str()), "{error}"),
            }
        }
    }
}

/// Each packed buffer says how much it unpacks to: what it says is no reason to ask for as much memory.
#[cfg(feature = "tables")]
#[test]
fn a_buffer_of_arrow_that_promises_too_much_is_left_out() {
    let folder = Folder::new();
    let whole = std::fs::read(golden("lz4.feather")).unwrap();
    let frames: Vec<usize> =
        (8..whole.len() - 4).filter(|at| whole[*at..at + 4] == [0x04, 0x22, 0x4d, 0x18]).collect();
    assert!(frames.len() >= 4);
    for at in frames {
        let mut bytes = whole.clone();
        bytes[at - 8..at].copy_from_slice(&(1_i64 << 60).to_le_bytes());
        let path = folder.write_bytes("bomb.feather", &bytes);
        match open(&path, &ReadOptions::default()) {
            Ok(recording) => assert!(
                recording.notes.iter().any(|n| n.contains("unpacks to more")),
                "{:?}",
                recording.notes
            ),
            Err(error) => assert!(error.to_string().contains("bomb.feather"), "{error}"),
        }
    }
}

/// The messages of a file without its magic word and its index are a stream.
#[cfg(feature = "tables")]
#[test]
fn a_stream_of_arrow_is_read_as_the_file_is() {
    let folder = Folder::new();
    let whole = std::fs::read(golden("data.arrow")).unwrap();
    let stream = folder.write_bytes("data.arrows", &whole[8..]);
    let (file, stream) =
        (read(&golden("data.arrow")), open(&stream, &ReadOptions::default()).unwrap());
    assert_eq!(file.topics[0].log.time_s(), stream.topics[0].log.time_s());
    assert_eq!(
        file.topics[0].log.names().collect::<Vec<_>>(),
        stream.topics[0].log.names().collect::<Vec<_>>()
    );
    assert!(file.notes.iter().all(|n| !n.contains("cut off")), "{:?}", file.notes);
}

#[test]
fn a_damaged_file_never_panics() {
    let folder = Folder::new();
    for file in expected().keys().filter(|file| readable(file)) {
        let whole = std::fs::read(golden(file)).unwrap();
        let mut state = 1_u64;
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..3 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                let at = (state >> 33) as usize % bytes.len();
                bytes[at] = (state >> 13) as u8;
            }
            let path = folder.write_bytes(file, &bytes);
            let _ = open(&path, &ReadOptions::default()).map(|recording| recording.listing());
        }
    }
}

#[test]
fn what_a_recorder_lost_is_said() {
    let notes = read(&golden("flight.ulg")).notes.join("\n");
    assert!(notes.contains("1 dropouts, 0.120 s together"), "{notes}");
    // The rest is found again behind bytes that mean nothing.
    let folder = Folder::new();
    let mut bytes = std::fs::read(golden("flight.ulg")).unwrap();
    let sync = bytes.windows(3).position(|w| w == [8, 0, b'S']).unwrap();
    for byte in &mut bytes[sync - 60..sync] {
        *byte = 0xee;
    }
    let recording = read(&folder.write_bytes("damaged.ulg", &bytes));
    let rates = &recording.topics.iter().find(|t| t.name == "vehicle_rates[0]").unwrap().log;
    assert!(
        rates.len() < 20 && rates.len() > 16 && rates.time_s().last().unwrap() > &1.07,
        "{}",
        rates.len()
    );
    assert!(
        recording.notes.iter().any(|n| n.contains("damaged from byte")),
        "{:?}",
        recording.notes
    );
}

#[test]
fn log_lists_topics_and_channels() {
    let out = deadtime(&["log", text(&golden("ros2_zstd.mcap"))]).done();
    for part in [
        "mcap, 2 topics",
        "/cmd_vel: 12 samples",
        "50 Hz",
        "angular.z",
        "position[2]",
        "recorded 0.004000 s after header.stamp",
        "█",
    ] {
        assert!(out.contains(part), "`{part}` is not in {out}");
    }
    let folder = Folder::new();
    let json = folder.path("log.json");
    deadtime(&["log", text(&golden("flight.ulg")), "--topic", "track", "--json", text(&json)])
        .done();
    let listing: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(listing["format"], "deadtime/log@1");
    assert_eq!(
        (listing["topics"].as_array().unwrap().len(), &listing["topics"][0]["samples"]),
        (1, &serde_json::json!(10))
    );
    assert_eq!(listing["topics"][0]["channels"][0]["short"], "points[0].x");
}

#[test]
fn header_stamps_are_used_when_asked_for() {
    let options = ReadOptions { stamps: deadtime::log::Stamps::Header, ..ReadOptions::default() };
    let recording = open(&golden("ros2_lz4.mcap"), &options).unwrap();
    let state = &recording.topics.iter().find(|t| t.name == "/state").unwrap().log;
    assert!((state.time_s()[0] + 0.003).abs() < TIME_TOLERANCE_S, "{:?}", state.time_s());
}

/// Of protobuf the sender's stamp stands in `timestamp`, 2 ms before the recorder's.
#[test]
fn time_stamps_of_protobuf_are_used_when_asked_for() {
    let options = ReadOptions { stamps: deadtime::log::Stamps::Header, ..ReadOptions::default() };
    let recording = open(&golden("protobuf.mcap"), &options).unwrap();
    let motor = &recording.topics[0].log;
    for (k, stamp) in motor.time_s().iter().enumerate() {
        assert!(
            (stamp - (0.005 * k as f64 - 0.002)).abs() < TIME_TOLERANCE_S,
            "{:?}",
            motor.time_s()
        );
    }
    for part in
        ["recorded 0.002000 s after timestamp", "/motor.picture: more than 64 elements; left out"]
    {
        assert!(recording.notes.iter().any(|n| n.contains(part)), "{:?}", recording.notes);
    }
}

/// One field of protobuf that holds bytes.
fn held(number: u8, bytes: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2, bytes.len() as u8], bytes].concat()
}

/// An MCAP file without chunks: messages of `test.S`, which has `double x = 1`, by these descriptors.
fn protobuf(descriptors: &[u8], name: &str, messages: &[&[u8]]) -> Vec<u8> {
    let text = |s: &[u8]| [&(s.len() as u32).to_le_bytes(), s].concat();
    let record = |kind: u8, content: Vec<u8>| {
        [&[kind], (content.len() as u64).to_le_bytes().as_slice(), &content].concat()
    };
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    let id = 1_u16.to_le_bytes();
    bytes.extend(record(
        3,
        [&id, text(name.as_bytes()).as_slice(), &text(b"protobuf"), &text(descriptors)].concat(),
    ));
    bytes.extend(record(
        4,
        [&id, id.as_slice(), &text(b"/s"), &text(b"protobuf"), &text(b"")].concat(),
    ));
    for (k, message) in messages.iter().enumerate() {
        let stamp = (k as u64 * 1_000_000).to_le_bytes();
        bytes.extend(record(5, [&id, [0; 4].as_slice(), &stamp, &stamp, message].concat()));
    }
    bytes.extend(record(15, vec![0; 4]));
    bytes
}

#[test]
fn protobuf_that_is_damaged_is_counted_or_named_with_a_remedy() {
    // FileDescriptorSet, FileDescriptorProto and so on, as descriptor.proto numbers their fields; label optional, type double.
    let field = [held(1, b"x"), vec![3 << 3, 1, 4 << 3, 1, 5 << 3, 1]].concat();
    let message = [held(1, b"S"), held(2, &field)].concat();
    let file =
        [held(1, b"s.proto"), held(2, b"test"), held(4, &message), held(12, b"proto3")].concat();
    let whole = held(1, &file);
    let x = [[9].as_slice(), &2.5_f64.to_le_bytes()].concat();
    let folder = Folder::new();
    // A message cut short, one of another type for the same field, an empty one (0), one with a field that the definition does not know.
    let unknown = [x.as_slice(), &[16, 7]].concat();
    let bytes = protobuf(&whole, "test.S", &[&x, &x[..5], &[8, 1], &[], &unknown]);
    let recording = read(&folder.write_bytes("s.mcap", &bytes));
    let samples = recording.topics[0].log.channel("x").unwrap().samples();
    assert_eq!(
        (0..3).map(|k| samples.get(k)).collect::<Vec<_>>(),
        [Some(2.5), Some(0.0), Some(2.5)]
    );
    assert!(
        recording
            .notes
            .iter()
            .any(|n| n.contains("/s: 2 of 5 messages do not fit their definition")),
        "{:?}",
        recording.notes
    );
    let importing = held(1, &[file.as_slice(), &held(3, b"other.proto")].concat());
    for (descriptors, name, parts) in [
        (&whole[..20], "test.S", ["no complete set of descriptors", "record it with every file"]),
        (&importing, "test.S", ["other.proto", "record it with every file"]),
        (&whole, "test.T", ["test.T", "has no such message, only test.S"]),
    ] {
        let log = folder.write_bytes("s.mcap", &protobuf(descriptors, name, &[&x]));
        deadtime(&["log", text(&log)]).refused(&["s.mcap", "/s", parts[0], parts[1]]);
    }
}

/// A flight whose rate answers the command 0.06 s late, in two topics of different rates.
fn two_rates(folder: &Folder) -> PathBuf {
    let message = |kind: u8, payload: &[u8]| {
        [&(payload.len() as u16).to_le_bytes(), [kind].as_slice(), payload].concat()
    };
    let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
    bytes.extend(0_u64.to_le_bytes());
    for format in
        ["command:uint64_t timestamp;float roll;", "gyro:uint64_t timestamp;double roll_rate;"]
    {
        bytes.extend(message(b'F', format.as_bytes()));
    }
    bytes.extend(message(b'A', b"\x00\x01\x00command"));
    bytes.extend(message(b'A', b"\x00\x02\x00gyro"));
    let (mut state, mut command, mut rate, mut past) =
        (1_u64, 1.0_f32, 0.0_f64, std::collections::VecDeque::from(vec![1.0_f64; 31]));
    // Milliseconds: the command every 10, the gyroscope every 2 and half a millisecond late.
    for ms in 0..12_000_u64 {
        if ms % 10 == 0 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            command = if state >> 62 == 0 { -command } else { command };
            let data =
                [[1, 0].as_slice(), &(ms * 1000).to_le_bytes(), &command.to_le_bytes()].concat();
            bytes.extend(message(b'D', &data));
        }
        if ms % 2 == 0 {
            past.push_back(f64::from(command));
            let late = past.pop_front().unwrap();
            rate += (late - rate) * 0.002 / 0.05;
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let noise = ((state >> 20) % 1000) as f64 / 1e5;
            let data = [
                [2, 0].as_slice(),
                &(ms * 1000 + 500).to_le_bytes(),
                &(rate + noise).to_le_bytes(),
            ]
            .concat();
            bytes.extend(message(b'D', &data));
        }
    }
    folder.write_bytes("two.ulg", &bytes)
}

#[test]
fn topics_of_different_rates_are_put_together() {
    let folder = Folder::new();
    let log = two_rates(&folder);
    let run = deadtime(&[
        "estimate",
        text(&log),
        "--input",
        "command.roll",
        "--output",
        "roll_rate",
        "--method",
        "oestruc",
    ]);
    assert!(
        run.stderr.contains("put onto the stamps of command")
            && run.stderr.contains("roll_rate interpolated"),
        "{}",
        run.stderr
    );
    let json = folder.path("e.json");
    deadtime(&[
        "estimate",
        text(&log),
        "--input",
        "roll",
        "--output",
        "roll_rate",
        "--method",
        "oestruc",
        "--json",
        text(&json),
    ])
    .done();
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let delay_s = report["pairs"][0]["estimates"][0]["delay_s"].as_f64().unwrap();
    assert!((delay_s - 0.062).abs() < 0.012, "{report}");
    deadtime(&["estimate", text(&log), "--input", "rol", "--output", "roll_rate"]).refused(&[
        "two.ulg",
        "`rol`",
        "did you mean `roll`",
        "`command.roll`",
    ]);
    let text_ = folder.write("log.csv", "time,u\n0,1\n1,1\n");
    let run = deadtime(&["log", text(&text_)]).done();
    assert!(run.contains("csv, 1 channels") && run.contains("2 samples"), "{run}");
}

fn json_channels(channels: &[(u16, &str, f64)]) -> Vec<u8> {
    json_channels_from(0, channels)
}

/// An MCAP file without chunks, of channels of one topic with messages in JSON: schema, definition and value of each.
fn json_channels_from(from_ns: u64, channels: &[(u16, &str, f64)]) -> Vec<u8> {
    let text = |s: &[u8]| [&(s.len() as u32).to_le_bytes(), s].concat();
    let record = |kind: u8, content: Vec<u8>| {
        [&[kind], (content.len() as u64).to_le_bytes().as_slice(), &content].concat()
    };
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    for (at, (schema, definition, _)) in channels.iter().enumerate() {
        let id = (at as u16).to_le_bytes();
        bytes.extend(record(
            3,
            [
                schema.to_le_bytes().as_slice(),
                &text(definition.as_bytes()),
                &text(b"jsonschema"),
                &text(b"{}"),
            ]
            .concat(),
        ));
        bytes.extend(record(
            4,
            [&id, schema.to_le_bytes().as_slice(), &text(b"/x"), &text(b"json"), &text(b"")]
                .concat(),
        ));
    }
    for k in 0..6_u64 {
        for (at, (_, _, value)) in channels.iter().enumerate() {
            let stamp = (from_ns + k * 10_000_000 + at as u64 * 1_000_000).to_le_bytes();
            let message = format!("{{\"v\": {value}}}");
            bytes.extend(record(
                5,
                [&(at as u16).to_le_bytes(), [0; 4].as_slice(), &stamp, &stamp, message.as_bytes()]
                    .concat(),
            ));
        }
    }
    bytes.extend(record(15, vec![0; 4]));
    bytes
}

#[test]
fn channels_of_one_name_are_put_together_or_numbered() {
    let folder = Folder::new();
    let log =
        read(&folder.write_bytes("same.mcap", &json_channels(&[(1, "A", 1.0), (1, "A", 2.0)])));
    assert_eq!((log.topics.len(), log.topics[0].log.len()), (1, 12));
    assert!(
        log.notes.iter().any(|n| n.contains("/x: several channels of one definition")),
        "{:?}",
        log.notes
    );
    let log =
        read(&folder.write_bytes("two.mcap", &json_channels(&[(1, "A", 1.0), (2, "B", 2.0)])));
    for (name, value) in [("/x.v", 1.0), ("/x[1].v", 2.0)] {
        let (_, channel) = log.channel(name).unwrap_or_else(|| panic!("{name}: {:?}", log.notes));
        assert_eq!(channel.samples().values, [value; 6]);
    }
}

#[test]
fn formats_that_are_not_read_are_named_with_a_remedy() {
    let folder = Folder::new();
    for (name, head, says) in [
        ("a.bag", b"#ROSBAG V2.0\n".as_slice(), "mcap convert"),
        ("a.xlsx", b"PK\x03\x04", "save the sheet as CSV"),
        ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1", "save the sheet as CSV"),
        ("a.npz", b"PK\x03\x04", "to_parquet"),
        ("a.npy", b"\x93NUMPY\x01", "deadtime.Log"),
        ("a.mf4", b"MDF     4.10", "asammdf"),
        ("a.tdms", b"TDSm", "npTDMS"),
        ("a.zip", b"PK\x03\x04", "unpack it"),
        ("a.mat", &[0; 200], "savemat"),
    ] {
        deadtime(&["log", text(&folder.write_bytes(name, head))]).refused(&[name, says]);
    }
}

/// Six messages a file, a file a second: the topics go on from one to the next, though their numbers change.
#[test]
fn the_files_of_a_bag_are_read_as_one() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("bag")).unwrap();
    for (name, from_ns, channels) in [
        ("bag/bag_10.mcap", 2_000_000_000, [(2, "B", 3.0), (1, "A", 30.0)].as_slice()),
        ("bag/bag_9.mcap", 1_000_000_000, [(1, "A", 2.0)].as_slice()),
        ("bag/bag_8.mcap", 0, [(1, "A", 1.0)].as_slice()),
    ] {
        folder.write_bytes(name, &json_channels_from(from_ns, channels));
    }
    let by_name = read(&folder.path("bag"));
    let (topic, channel) = by_name.channel("/x.v").unwrap();
    assert_eq!(channel.samples().values, [[1.0; 6], [2.0; 6], [30.0; 6]].concat());
    let meant: Vec<f64> = (0..18)
        .map(|k| f64::from(k / 6) + 0.01 * f64::from(k % 6) + if k < 12 { 0.0 } else { 0.001 })
        .collect();
    for (found, meant) in topic.log.time_s().iter().zip(&meant) {
        assert!((found - meant).abs() < 1e-9, "{found} for {meant}");
    }
    assert_eq!(by_name.channel("/x[1].v").unwrap().1.samples().values, [3.0; 6]);
    assert!(
        !by_name
            .notes
            .iter()
            .any(|note| note.contains("runs back") || note.contains("several channels")),
        "{:?}",
        by_name.notes
    );
    // As the recorder of ROS 2 writes it; only what it names is read.
    let metadata = "rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n    - bag_8.mcap\n    - bag_9.mcap\n  duration:\n    nanoseconds: 5\n";
    folder.write_bytes("bag/metadata.yaml", metadata.as_bytes());
    assert_eq!(read(&folder.path("bag")).channel("/x.v").unwrap().0.log.len(), 12);
    deadtime(&["log", text(&folder.path("bag"))]).done();
    // What is cut off is said with the name of its file.
    let whole = std::fs::read(folder.path("bag/bag_8.mcap")).unwrap();
    folder.write_bytes("bag/bag_8.mcap", &whole[..whole.len() - 20]);
    let cut = read(&folder.path("bag"));
    assert!(
        cut.notes.iter().any(|note| note.starts_with("bag_8.mcap: cut off at byte")),
        "{:?}",
        cut.notes
    );
    std::fs::remove_file(folder.path("bag/bag_9.mcap")).unwrap();
    deadtime(&["log", text(&folder.path("bag"))]).refused(&["bag_9.mcap"]);
    std::fs::create_dir(folder.path("none")).unwrap();
    deadtime(&["log", text(&folder.path("none"))])
        .refused(&["none", "a folder without files that end in .mcap or .db3"]);
    folder.write_bytes("none/metadata.yaml", b"  relative_file_paths:\n    - a.db3.zstd\n");
    folder.write_bytes("none/a.db3.zstd", b"\x28\xb5\x2f\xfd");
    deadtime(&["log", text(&folder.path("none"))]).refused(&["a.db3.zstd", "zstd -d"]);
}
