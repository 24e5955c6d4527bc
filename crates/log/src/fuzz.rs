//! `DEADTIME_FUZZ_ROUNDS` mutants of each file are drawn with `DEADTIME_FUZZ_SEED`; `scripts/fuzz` goes on for minutes.
//!
//! Damaged files, or files that would take memory or time without end. The result is an error, correct values, or a note.

use std::io::Write;
use std::path::{Path, PathBuf};

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{LogError, ReadOptions, Recording, open};

fn corpus(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
    files.retain(|f| f.extension().is_none_or(|e| e != "md" && e != "json"));
    files.sort();
    files
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn read(&self, bytes: &[u8], options: &ReadOptions) -> Result<Recording, crate::Error> {
        let path = self.0.path().join("log.bin");
        std::fs::write(&path, bytes).unwrap();
        open(&path, options)
    }

    fn said(&self, bytes: &[u8]) -> String {
        match self.read(bytes, &ReadOptions::default()) {
            Ok(recording) => recording.notes.join("|"),
            Err(error) => error.to_string(),
        }
    }
}

/// The same topics with the same numbers.
fn same(a: &Recording, b: &Recording) -> bool {
    a.topics.len() == b.topics.len()
        && a.topics.iter().zip(&b.topics).all(|(a, b)| {
            let of = |log: &crate::Log, name: &str| -> Vec<Option<u64>> {
                let samples = log.channel(name).unwrap().samples();
                (0..log.len()).map(|k| samples.get(k).map(f64::to_bits)).collect()
            };
            a.name == b.name
                && a.log.time_s() == b.log.time_s()
                && a.log.names().eq(b.log.names())
                && a.log.names().all(|name| of(&a.log, name) == of(&b.log, name))
        })
}

/// A number of the environment.
fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(otherwise)
}

fn drawing(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(number("DEADTIME_FUZZ_SEED", 0).wrapping_mul(1000) + seed)
}

/// The sizes at which lengths, counts and pointers fail.
fn size(length: usize, rng: &mut impl Rng) -> u64 {
    let sizes =
        [0, 1, 0x7f, 0xff, 0x7fff_ffff, 0xffff_ffff, u64::MAX >> 1, u64::MAX, length as u64];
    sizes[rng.random_range(0..sizes.len())].wrapping_add(rng.random_range(0..2))
}

/// Some bytes changed, left out, doubled or cut off, or a length, count or pointer set to what such break on.
fn mutant(bytes: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..rng.random_range(1..=2) {
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..9) {
            0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 | 2 => bytes[at] = rng.random(),
            3 => {
                let end = (at + rng.random_range(1..16)).min(bytes.len());
                bytes[at..end].fill(if rng.random() { 0 } else { 0xff });
            }
            4 => bytes.truncate(at.max(1)),
            5 | 6 => {
                // Most numbers of four or eight bytes are aligned.
                let (at, wide) = (at & !3, if rng.random() { 4 } else { 8 });
                let written = size(bytes.len(), rng).to_le_bytes();
                let end = (at + wide).min(bytes.len());
                bytes[at..end].copy_from_slice(&written[..end - at]);
            }
            7 => {
                bytes.remove(at);
            }
            _ => bytes.insert(at, rng.random()),
        }
    }
    bytes
}

/// The words of notes on damage.
const DAMAGE: [&str; 8] = [
    "cut off",
    "damaged",
    "left out",
    "not as they were written",
    "does not match",
    "no sense",
    "not read",
    "have no end",
];

#[test]
fn damage_of_files_with_checksums_is_said_or_changes_nothing() {
    let folder = Folder::new();
    let options = ReadOptions::default();
    let mut rng = drawing(47);
    let rounds = number("DEADTIME_FUZZ_ROUNDS", 400);
    for path in corpus("golden/log_files") {
        if path.extension().is_none_or(|e| e != "mcap") {
            continue;
        }
        let mut bytes = std::fs::read(&path).unwrap();
        if path.ends_with("json.mcap") {
            // Its writer left messages without chunks, and the data without a checksum.
            let end = record(15, &[0; 4]);
            let at = bytes.windows(end.len()).position(|b| b == end).unwrap();
            let sum = crc32fast::hash(&bytes[..at]).to_le_bytes();
            bytes[at + end.len() - 4..at + end.len()].copy_from_slice(&sum);
        }
        let whole = folder.read(&bytes, &options).unwrap();
        let (mut said, mut equal) = (0_u64, 0_u64);
        for round in 0..rounds {
            let mutant = mutant(&bytes, &mut rng);
            match folder.read(&mutant, &options) {
                Ok(read) if same(&read, &whole) => equal += 1,
                Ok(read) => {
                    let new = read.notes.iter().filter(|n| !whole.notes.contains(n));
                    let of_damage = |n: &str| DAMAGE.iter().any(|word| n.contains(word));
                    let noted = new.map(ToString::to_string).any(|n| of_damage(&n));
                    assert!(noted, "{} {round}: {:?}", path.display(), read.notes);
                    said += 1;
                }
                Err(_) => said += 1,
            }
        }
        assert!(
            said > rounds / 6 && equal > rounds / 30,
            "{}: {said} said, {equal} equal",
            path.display()
        );
    }
}

/// A mutant of any format ends, within its budget, as an error or as a log that can be listed.
#[test]
fn mutants_of_every_format_end() {
    let folder = Folder::new();
    let mut rng = drawing(53);
    let rounds = number("DEADTIME_FUZZ_ROUNDS", 400).div_ceil(4);
    for path in corpus("golden/log_files").into_iter().chain(corpus("tests/corpus/log_files")) {
        let bytes = std::fs::read(&path).unwrap();
        for round in 0..rounds {
            let mutant = mutant(&bytes, &mut rng);
            let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                let recording = folder.read(&mutant, &ReadOptions::default()).ok()?;
                serde_json::to_string(&recording.listing()).ok()
            }));
            if read.is_err() {
                let kept =
                    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/corpus/log_files");
                let name = format!("{}-{round}", path.file_name().unwrap().to_string_lossy());
                std::fs::write(kept.join(&name), &mutant).unwrap();
                panic!("{name}: panicked");
            }
        }
    }
}

#[test]
fn a_chunk_that_is_not_as_it_was_written_is_left_out_unless_it_is_wanted() {
    let bytes = std::fs::read(
        corpus("golden/log_files").into_iter().find(|f| f.ends_with("ros2_plain.mcap")).unwrap(),
    )
    .unwrap();
    let folder = Folder::new();
    let whole = folder.read(&bytes, &ReadOptions::default()).unwrap();
    // A number within the messages: no record loses its place.
    let number = whole.topics[0].log.channel("linear.x").unwrap().samples().get(5).unwrap();
    let at = bytes.windows(8).position(|b| b == number.to_le_bytes()).unwrap();
    let mut damaged = bytes;
    damaged[at + 7] ^= 1;
    let said = folder.said(&damaged);
    assert!(
        said.contains("chunks are not as they were written, by their checksums (at byte ")
            && said.contains("left out: `unchecked`"),
        "{said}"
    );
    let options = ReadOptions { unchecked: true, ..ReadOptions::default() };
    let read = folder.read(&damaged, &options).unwrap();
    assert!(read.notes.join("|").contains("read all the same"), "{:?}", read.notes);
    assert_eq!(read.topics[0].log.len(), whole.topics[0].log.len());
    assert!(!same(&read, &whole));
}

#[test]
fn what_broke_a_reader_ends_and_says_why() {
    for path in corpus("tests/corpus/log_files") {
        let read = open(&path, &ReadOptions::default());
        let said = match &read {
            Ok(recording) => recording.notes.join("|"),
            Err(error) => error.to_string(),
        };
        let name = path.file_name().unwrap().to_str().unwrap();
        for (file, why) in [
            ("r2rec.mcap", "the definition of p/A holds itself"),
            ("crcbad.mcap", "1 of 1 chunks are not as they were written"),
            ("cyc3.h5", "another name of a group that was read"),
            ("panic-delta.parquet-7-221.parquet", "its parts do not fit together"),
        ] {
            // A format that is not built in is named as such.
            let left_out = said.contains("built without the feature");
            assert!(name != file || left_out || said.contains(why), "{name}: {said}");
        }
    }
}

/// A record of MCAP.
fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(content.len() as u64).to_le_bytes(), content].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// An MCAP file of one topic in ROS 2 with a definition and messages.
fn mcap(definition: &str, messages: &[Vec<u8>]) -> Vec<u8> {
    let mut file = b"\x89MCAP0\r\n".to_vec();
    let schema =
        [&1_u16.to_le_bytes()[..], &text("p/msg/X"), &text("ros2msg"), &text(definition)].concat();
    file.extend(record(3, &schema));
    let channel = [
        &1_u16.to_le_bytes()[..],
        &1_u16.to_le_bytes(),
        &text("/x"),
        &text("cdr"),
        &0_u32.to_le_bytes(),
    ]
    .concat();
    file.extend(record(4, &channel));
    for (k, message) in messages.iter().enumerate() {
        let stamp = (k as u64 * 1_000_000).to_le_bytes();
        let head = [&1_u16.to_le_bytes()[..], &0_u32.to_le_bytes(), &stamp, &stamp, &[0, 1, 0, 0]]
            .concat();
        file.extend(record(5, &[head, message.clone()].concat()));
    }
    file.extend(record(15, &0_u32.to_le_bytes()));
    file
}

#[test]
fn definitions_that_hold_themselves_or_nothing_end() {
    let folder = Folder::new();
    let line = "=".repeat(80);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..40 {
        // A circle of so many messages, by one, several or any number of each.
        let length = rng.random_range(1..12);
        let count = ["", "[]", "[3]", "[<=9]"][rng.random_range(0..4)];
        let mut definition = format!("float64 u\nM0{count} m\n");
        for k in 0..length {
            definition += &format!("{line}\nMSG: p/M{k}\nM{}{count} inner\n", (k + 1) % length);
        }
        let message = [&1.0_f64.to_le_bytes()[..], &[0; 64]].concat();
        let said = folder.said(&mcap(&definition, &[message]));
        assert!(said.contains("holds itself"), "{definition}: {said}");
    }
    // Messages of nothing, doubled at every level: nothing is walked through.
    let mut definition = "float64 u\nM0[4000000000] none\nM0[] some\nfloat64 y\n".to_owned();
    for k in 0..28 {
        definition += &format!("{line}\nMSG: p/M{k}\nM{}[1000] a\nM{} b\n", k + 1, k + 1);
    }
    definition += &format!("{line}\nMSG: p/M28\n# nothing\nint8 X=1\n");
    let message = |u: f64, some: u32| {
        [&u.to_le_bytes()[..], &some.to_le_bytes(), &[0; 4], &(-u).to_le_bytes()].concat()
    };
    let file = mcap(&definition, &[message(1.0, 3), message(2.0, 8), message(3.0, u32::MAX)]);
    let read = folder.read(&file, &ReadOptions::default()).unwrap();
    let log = &read.topics[0].log;
    assert_eq!(
        (log.input("u").unwrap(), log.input("y").unwrap()),
        (&[1.0, 2.0][..], &[-1.0, -2.0][..])
    );
    assert!(read.notes.join("|").contains("1 of 3 messages do not fit"), "{:?}", read.notes);
}

/// A chunk of so many zeros in one message.
fn bomb(compression: &str, zeros: usize) -> Vec<u8> {
    let head = [&7_u16.to_le_bytes()[..], &[0; 20]].concat();
    let plain = record(5, &[head, vec![0; zeros]].concat());
    let packed = match compression {
        "lz4" => {
            let mut packed = lz4_flex::frame::FrameEncoder::new(Vec::new());
            packed.write_all(&plain).unwrap();
            packed.finish().unwrap()
        }
        "zstd" => ruzstd::encoding::compress_to_vec(
            plain.as_slice(),
            ruzstd::encoding::CompressionLevel::Fastest,
        ),
        _ => plain.clone(),
    };
    let chunk = [
        &[0; 16][..],
        &(plain.len() as u64).to_le_bytes(),
        &0_u32.to_le_bytes(),
        &text(compression),
        &(packed.len() as u64).to_le_bytes(),
        &packed,
    ]
    .concat();
    [b"\x89MCAP0\r\n".to_vec(), record(6, &chunk), record(15, &[0; 4])].concat()
}

#[test]
fn what_unpacks_to_more_than_its_budget_is_refused_and_the_limit_can_be_lifted() {
    let folder = Folder::new();
    for compression in ["lz4", "zstd"] {
        let bytes = bomb(compression, 100 << 20);
        assert!(bytes.len() < 4 << 20);
        let refused = folder.read(&bytes, &ReadOptions::default()).unwrap_err();
        assert!(matches!(refused, crate::Error::Log(LogError::Memory { .. })), "{refused}");
        assert!(refused.to_string().contains("`max_memory_gb`"), "{refused}");
        let lifted = ReadOptions { memory: Some(200 << 20), ..ReadOptions::default() };
        let said = folder.read(&bytes, &lifted).unwrap_err().to_string();
        assert!(said.contains("1 messages are of channels that the file does not name"), "{said}");
    }
    // A variable of MAT 5 that unpacks to as much.
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(&vec![0; 100 << 20]).unwrap();
    let packed = packed.finish().unwrap();
    let mut file = [&[b' '; 124][..], &[0, 1, b'I', b'M']].concat();
    file.extend(15_u32.to_le_bytes());
    file.extend((packed.len() as u32).to_le_bytes());
    file.extend(&packed);
    let said = folder.said(&file);
    assert!(
        said.contains("the variable at byte 128 takes more memory than is left of 65 MiB"),
        "{said}"
    );
}

/// A database of one table `messages`; the payload of its only cell is on overflow pages, each followed by the page that `next` gives.
fn database(pages: usize, next: impl Fn(usize) -> u32) -> Vec<u8> {
    const PAGE: usize = 512;
    let mut file = vec![0; PAGE * pages];
    file[..16].copy_from_slice(b"SQLite format 3\0");
    file[16..18].copy_from_slice(&(PAGE as u16).to_be_bytes());
    // Cells that all claim to be as long as the file.
    let claim = (PAGE * pages) as u64;
    let mut cell: Vec<u8> = (0..9).rev().map(|k| (claim >> (7 * k)) as u8 & 0x7f | 0x80).collect();
    cell.truncate(8);
    let mut cell = vec![
        0x80 | (claim >> 14) as u8 & 0x7f,
        0x80 | (claim >> 7) as u8 & 0x7f,
        claim as u8 & 0x7f,
        1,
    ];
    cell.extend([1; 120]);
    let cells = 100;
    file[100] = 13;
    file[103..105].copy_from_slice(&(cells as u16).to_be_bytes());
    let at = PAGE - cell.len() - 8;
    for k in 0..cells {
        file[108 + 2 * k..110 + 2 * k].copy_from_slice(&(at as u16).to_be_bytes());
    }
    file[at..at + cell.len()].copy_from_slice(&cell);
    for page in 1..pages {
        let link = next(page).to_be_bytes();
        file[PAGE * page..PAGE * page + 4].copy_from_slice(&link);
    }
    file
}

/// A file in memory that counts the reads of whole pages.
struct Counting<'a> {
    file: std::io::Cursor<Vec<u8>>,
    reads: &'a std::cell::Cell<usize>,
}

impl std::io::Read for Counting<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        self.reads.set(self.reads.get() + 1);
        self.file.read(into)
    }
}

impl std::io::Seek for Counting<'_> {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

#[test]
fn overflow_pages_in_a_circle_are_read_no_more_often_than_the_file_has_pages() {
    let folder = Folder::new();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..6 {
        let pages = rng.random_range(100..4000);
        let round = rng.random_range(1..pages) as u32;
        let file = database(pages, |page| (page as u32 % round) + 2);
        let _ = folder.said(&file);
        let reads = std::cell::Cell::new(0);
        let counting = Counting { file: std::io::Cursor::new(file), reads: &reads };
        let mut database = crate::sqlite::Database::open(counting).unwrap().unwrap();
        let opened = reads.get();
        database.tables();
        let walked = reads.get() - opened;
        assert!(walked <= pages + 1, "{walked} reads of {pages} pages, {round} in a circle");
    }
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused_and_not_waited_for() {
    use crate::{Error, Follower};
    let folder = tempfile::tempdir().unwrap();
    let [log, fifo] = ["log.csv", "fifo.csv"].map(|name| folder.path().join(name));
    std::fs::write(&log, "time,u\n0,1\n0.1,2\n").unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let options = ReadOptions::default();
    let refused = |e: &Error| matches!(e, Error::Log(LogError::NoFile { .. }));
    assert!(refused(&open(&fifo, &options).unwrap_err()));
    assert!(refused(&Follower::open(&fifo, &["u"], &options).unwrap_err()));
    let mut follower = Follower::open(&log, &["u"], &options).unwrap();
    assert!(follower.poll().unwrap().grown);
    assert!(!follower.poll().unwrap().grown);
    // Gone for a while is waited for; a pipe in its place is not.
    std::fs::remove_file(&log).unwrap();
    assert!(!follower.poll().unwrap().grown);
    std::fs::rename(&fifo, &log).unwrap();
    assert!(refused(&follower.poll().unwrap_err()));
}

#[cfg(feature = "tables")]
mod tables {
    use std::sync::Arc;

    use parquet::basic::{Compression, Encoding, GzipLevel, ZstdLevel};
    use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
    use parquet::file::properties::{WriterProperties, WriterVersion};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    use super::*;

    /// A table of time, numbers with gaps, whole numbers and text.
    fn table(
        rows: usize,
        properties: WriterProperties,
        rng: &mut impl Rng,
    ) -> (Vec<u8>, Vec<Option<f64>>, Vec<f64>) {
        let schema = "message log { required int64 time_us; optional double y; required int32 n; required binary txt (UTF8); }";
        let schema = Arc::new(parse_message_type(schema).unwrap());
        let mut bytes = Vec::new();
        let mut writer =
            SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties)).unwrap();
        let y: Vec<Option<f64>> = (0..rows)
            .map(|_| rng.random_bool(0.8).then(|| f64::from(rng.random_range(-9..9))))
            .collect();
        let n: Vec<i32> = (0..rows).map(|_| rng.random_range(-5..5)).collect();
        let groups = 3;
        for group in 0..groups {
            let part = rows * group / groups..rows * (group + 1) / groups;
            let mut out = writer.next_row_group().unwrap();
            let mut column = out.next_column().unwrap().unwrap();
            let time: Vec<i64> = part.clone().map(|k| k as i64 * 10_000).collect();
            column.typed::<Int64Type>().write_batch(&time, None, None).unwrap();
            column.close().unwrap();
            let mut column = out.next_column().unwrap().unwrap();
            let levels: Vec<i16> = y[part.clone()].iter().map(|v| i16::from(v.is_some())).collect();
            let values: Vec<f64> = y[part.clone()].iter().flatten().copied().collect();
            column.typed::<DoubleType>().write_batch(&values, Some(&levels), None).unwrap();
            column.close().unwrap();
            let mut column = out.next_column().unwrap().unwrap();
            column.typed::<Int32Type>().write_batch(&n[part.clone()], None, None).unwrap();
            column.close().unwrap();
            let mut column = out.next_column().unwrap().unwrap();
            let texts: Vec<ByteArray> = part.map(|_| ByteArray::from("text")).collect();
            column.typed::<ByteArrayType>().write_batch(&texts, None, None).unwrap();
            column.close().unwrap();
            out.close().unwrap();
        }
        writer.close().unwrap();
        (bytes, y, n.into_iter().map(f64::from).collect())
    }

    fn drawn(rng: &mut impl Rng) -> WriterProperties {
        let packed = [
            Compression::UNCOMPRESSED,
            Compression::SNAPPY,
            Compression::GZIP(GzipLevel::default()),
            Compression::LZ4,
            Compression::LZ4_RAW,
            Compression::ZSTD(ZstdLevel::default()),
        ];
        let version =
            if rng.random() { WriterVersion::PARQUET_1_0 } else { WriterVersion::PARQUET_2_0 };
        let mut properties = WriterProperties::builder()
            .set_compression(packed[rng.random_range(0..packed.len())])
            .set_writer_version(version)
            .set_data_page_row_count_limit(rng.random_range(20..400))
            .set_write_batch_size(rng.random_range(1..50))
            .set_dictionary_enabled(rng.random());
        if rng.random() {
            let whole =
                [Encoding::PLAIN, Encoding::DELTA_BINARY_PACKED, Encoding::BYTE_STREAM_SPLIT];
            for (column, encodings) in [
                ("time_us", &whole[..]),
                ("n", &whole),
                ("y", &[Encoding::PLAIN, Encoding::BYTE_STREAM_SPLIT]),
            ] {
                let encoding = encodings[rng.random_range(0..encodings.len())];
                properties = properties
                    .set_column_encoding(column.into(), encoding)
                    .set_column_dictionary_enabled(column.into(), false);
            }
        }
        properties.build()
    }

    #[test]
    fn every_encoding_and_compression_reads_back() {
        let folder = Folder::new();
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for round in 0..60 {
            let rows = rng.random_range(10..900);
            let properties = drawn(&mut rng);
            let what = format!("{round}: {properties:?}");
            let (bytes, y, n) = table(rows, properties, &mut rng);
            let read = folder.read(&bytes, &ReadOptions::default()).unwrap();
            let log = &read.topics[0].log;
            assert_eq!(
                (log.len(), log.input("n").unwrap()),
                (rows, n.as_slice()),
                "{what} {:?}",
                read.notes
            );
            let samples = log.channel("y").unwrap().samples();
            assert_eq!((0..rows).map(|k| samples.get(k)).collect::<Vec<_>>(), y, "{what}");
            assert_eq!(log.time_s()[rows - 1], (rows - 1) as f64 * 1e4 / 1e6, "{what}");
        }
    }

    /// A variable-length number of Thrift's compact protocol.
    fn varint(mut value: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        while value >= 0x80 {
            bytes.push(value as u8 & 0x7f | 0x80);
            value >>= 7;
        }
        bytes.push(value as u8);
        bytes
    }

    fn field(delta: u8, value: i64) -> Vec<u8> {
        [vec![delta << 4 | 5], varint(((value << 1) ^ (value >> 63)).cast_unsigned())].concat()
    }

    /// An uncompressed page of numbers with its checksum, as other writers make it.
    fn page(values: &[f64]) -> Vec<u8> {
        let body: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let size = body.len() as i64;
        let sum = i64::from(crc32fast::hash(&body).cast_signed());
        let inner = [field(1, values.len() as i64), field(1, 0), field(1, 3), field(1, 3), vec![0]]
            .concat();
        let head = [
            field(1, 0),
            field(1, size),
            field(1, size),
            field(1, sum),
            vec![1 << 4 | 12],
            inner,
            vec![0],
        ];
        [head.concat(), body].concat()
    }

    fn read_pages(bytes: &[u8], unchecked: bool) -> (Vec<f64>, Vec<(usize, usize)>, usize) {
        use crate::budget::Budget;
        use crate::pages::{Chunk, Lost, Pages};
        use parquet::column::reader::{get_column_reader, get_typed_column_reader};
        use std::sync::Mutex;

        let schema = parse_message_type("message log { required double u; }").unwrap();
        let schema = parquet::schema::types::SchemaDescriptor::new(Arc::new(schema));
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        let lost = Arc::new(Mutex::new(Lost::default()));
        let chunk = Chunk {
            kind: parquet::basic::Type::DOUBLE,
            compression: Compression::UNCOMPRESSED,
            unchecked,
            budget: Budget::default(),
            lost: lost.clone(),
        };
        let pages = Pages::new(&file, (0, bytes.len() as u64), chunk).unwrap();
        let reader = get_column_reader(schema.column(0), Box::new(pages));
        let mut reader = get_typed_column_reader::<DoubleType>(reader);
        let mut values = Vec::new();
        while reader.read_records(64, None, None, &mut values).unwrap().0 > 0 {}
        let lost = lost.lock().unwrap();
        (values, lost.rows.clone(), lost.pages)
    }

    #[test]
    fn pages_that_are_not_as_they_were_written_are_left_out_with_their_rows() {
        let mut rng = ChaCha8Rng::seed_from_u64(19);
        for _ in 0..50 {
            let parts: Vec<Vec<f64>> = (0..rng.random_range(1..8))
                .map(|_| {
                    (0..rng.random_range(1..90))
                        .map(|_| f64::from(rng.random_range(-9..9)))
                        .collect()
                })
                .collect();
            let (mut bytes, mut kept, mut all, mut gone) =
                (Vec::new(), Vec::new(), Vec::<f64>::new(), Vec::new());
            for part in &parts {
                let mut page = page(part);
                if rng.random_bool(0.3) {
                    // Below the values' exponents: they stay numbers.
                    let at = page.len() - 8 * rng.random_range(1..=part.len());
                    page[at] ^= 1;
                    gone.push((all.len(), part.len()));
                } else {
                    kept.extend(part);
                }
                all.extend(part);
                bytes.extend(page);
            }
            assert_eq!(read_pages(&bytes, false), (kept, gone.clone(), gone.len()));
            let (values, rows, pages) = read_pages(&bytes, true);
            assert_eq!((values.len(), rows.len(), pages), (all.len(), 0, gone.len()));
        }
    }

    #[test]
    fn fresh_tables_that_are_damaged_end_without_a_panic() {
        let folder = Folder::new();
        let mut rng = drawing(13);
        for _ in 0..number("DEADTIME_FUZZ_ROUNDS", 400).div_ceil(10) {
            let properties = drawn(&mut rng);
            let (bytes, ..) = table(200, properties, &mut rng);
            for _ in 0..25 {
                let mutant = mutant(&bytes, &mut rng);
                let _ = folder.read(&mutant, &ReadOptions::default());
            }
        }
    }

    #[test]
    fn columns_beyond_the_budget_are_left_out_and_named() {
        let folder = Folder::new();
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let (bytes, ..) = table(3000, WriterProperties::builder().build(), &mut rng);
        // Room for the time and one column more.
        let options = ReadOptions { memory: Some(3000 * 24 + 20_000), ..ReadOptions::default() };
        let read = folder.read(&bytes, &options).unwrap();
        assert_eq!(read.topics[0].log.names().collect::<Vec<_>>(), ["y"]);
        assert!(
            read.notes.join("|").contains("n takes more memory than is left of 1 MiB"),
            "{:?}",
            read.notes
        );
    }
}
