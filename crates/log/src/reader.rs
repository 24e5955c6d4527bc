//! The registry of readers: which format a file is in, by its first bytes, then by its name.

use std::io::Read;
use std::path::Path;

use super::channels::Log;
use super::error::{Error, LogError};
use super::options::ReadOptions;
use super::recording::Recording;
use super::{csv, folder, mat, mcap, rosbag2, sentinel, ulog};

/// As many bytes as any format is recognised by.
const HEAD: usize = 520;

/// One format of log files.
pub struct Reader {
    /// Its name.
    pub name: &'static str,
    /// Its summary, in one line.
    pub summary: &'static str,
    /// How its files' names end, without the dot.
    pub extensions: &'static [&'static str],
    /// Whether a file with this beginning is of the format.
    pub sniff: fn(&[u8]) -> bool,
    /// Reads a file.
    pub open: fn(&Path, &ReadOptions) -> Result<Recording, Error>,
}

/// The answer of a program without those readers.
#[cfg(not(feature = "tables"))]
const WITHOUT: &str = "this program was built without the feature `tables`; write it as CSV";

#[cfg(not(feature = "tables"))]
fn unread(path: &Path, format: &'static str, remedy: &str) -> Error {
    let what = format!("this format is recognised but not read: {remedy}");
    LogError::format(&path.display().to_string(), format, what).into()
}

/// Every format; the last one takes all unrecognised files.
pub const READERS: &[Reader] = &[
    Reader {
        name: "ulog",
        summary: "ULog of PX4: topics with instances, dropouts, appended data",
        extensions: &["ulg"],
        sniff: |head| head.starts_with(ulog::MAGIC),
        open: ulog::open,
    },
    Reader {
        name: "mcap",
        summary: "MCAP: topics of ROS 2 (CDR), ROS 1 and protobuf messages by their definitions, and JSON; plain, lz4 or zstd chunks",
        extensions: &["mcap"],
        sniff: |head| head.starts_with(mcap::MAGIC),
        open: mcap::open,
    },
    Reader {
        name: "rosbag2",
        summary: "bags of ROS 2 in SQLite; messages by the definitions in the bag, or by their names",
        extensions: &["db3"],
        sniff: |head| head.starts_with(rosbag2::MAGIC),
        open: rosbag2::open,
    },
    Reader {
        name: "mat",
        summary: "MAT 5 to 7 of MATLAB and Simulink: vectors with a vector of time, structs of arrays, structures with time, timeseries, Datasets",
        extensions: &["mat"],
        sniff: mat::is_mat5,
        open: mat::open,
    },
    Reader {
        name: "hdf5",
        summary: "HDF5 and MAT 7.3: vectors and matrices with a vector of time, groups and structs of them, MATLAB's objects",
        extensions: &["h5", "hdf5"],
        sniff: |head| {
            [0, 512].iter().any(|at| {
                head.get(*at..).is_some_and(|rest| rest.starts_with(b"\x89HDF\r\n\x1a\n"))
            })
        },
        #[cfg(feature = "tables")]
        open: super::hdf5::open,
        #[cfg(not(feature = "tables"))]
        open: |path, _| Err(unread(path, "HDF5 (MAT 7.3)", WITHOUT)),
    },
    Reader {
        name: "parquet",
        summary: "Parquet: every column of numbers, one of them time; snappy, gzip, lz4 and zstd",
        extensions: &["parquet", "pq"],
        sniff: |head| head.starts_with(b"PAR1"),
        #[cfg(feature = "tables")]
        open: super::parquet::open,
        #[cfg(not(feature = "tables"))]
        open: |path, _| Err(unread(path, "Parquet", WITHOUT)),
    },
    Reader {
        name: "arrow",
        summary: "Arrow IPC, files (Feather) and streams: every column of numbers, one of them time; lz4 and zstd",
        extensions: &["arrow", "arrows", "feather", "ipc"],
        sniff: |head| head.starts_with(b"ARROW1") || head.starts_with(&[0xff; 4]),
        #[cfg(feature = "tables")]
        open: super::arrow::open,
        #[cfg(not(feature = "tables"))]
        open: |path, _| Err(unread(path, "Arrow IPC", WITHOUT)),
    },
    Reader {
        name: "csv",
        summary: "text: a header row, a column of time, one row per sample; separated by comma, semicolon, tab, bar or blanks; .gz too",
        extensions: &["csv", "csv.gz", "tsv", "tsv.gz", "txt", "txt.gz"],
        sniff: |_| false,
        open: csv::table::recording,
    },
];

/// A format that is known and not read.
struct Foreign {
    /// The name of the format.
    name: &'static str,
    /// How such a file begins.
    head: &'static [u8],
    /// How its name ends; empty: its first bytes are enough.
    extensions: &'static [&'static str],
    /// The remedy.
    remedy: &'static str,
}

const FOREIGN: &[Foreign] = &[
    Foreign {
        name: "a bag of ROS 1",
        head: b"#ROSBAG",
        extensions: &[],
        remedy: "convert it to MCAP: `mcap convert FILE.bag FILE.mcap`, or to a bag of ROS 2 by rosbags-convert of the Python package rosbags",
    },
    Foreign {
        name: "a workbook of Excel",
        head: b"PK\x03\x04",
        extensions: &["xlsx", "xlsm"],
        remedy: "save the sheet as CSV, or in Python: pandas.read_excel(FILE).to_csv(\"log.csv\", index=False)",
    },
    Foreign {
        name: "a workbook of Excel",
        head: b"\xd0\xcf\x11\xe0",
        extensions: &["xls"],
        remedy: "save the sheet as CSV, or in Python: pandas.read_excel(FILE).to_csv(\"log.csv\", index=False)",
    },
    Foreign {
        name: "arrays of numpy",
        head: b"PK\x03\x04",
        extensions: &["npz"],
        remedy: "in Python: pandas.DataFrame(dict(numpy.load(FILE))).to_parquet(\"log.parquet\"), where all arrays are as long as `time`; or deadtime.Log(time, channels)",
    },
    Foreign {
        name: "an array of numpy",
        head: b"\x93NUMPY",
        extensions: &[],
        remedy: "give its columns names and a time: deadtime.Log(time, channels) in Python, or write CSV",
    },
    Foreign {
        name: "a measurement in MDF",
        head: b"MDF     ",
        extensions: &[],
        remedy: "export it as CSV or MAT, in Python by asammdf: MDF(FILE).to_dataframe().to_csv(\"log.csv\", index_label=\"time\")",
    },
    Foreign {
        name: "a measurement in TDMS",
        head: b"TDSm",
        extensions: &[],
        remedy: "export it as CSV, in Python by npTDMS: TdmsFile.read(FILE).as_dataframe(time_index=True).to_csv(\"log.csv\", index_label=\"time\")",
    },
    Foreign {
        name: "a ZIP archive",
        head: b"PK\x03\x04",
        extensions: &[],
        remedy: "unpack it, and give the log in it",
    },
];

/// A bag of ROS 2 as a folder.
const FOLDER: Reader = Reader {
    name: "rosbag2",
    summary: "folders of bags of ROS 2, of one or more files",
    extensions: &[],
    sniff: |_| false,
    open: folder::open,
};

/// The format of a file: by its first bytes, then by its name; otherwise text.
///
/// # Errors
/// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`LogError::Format`] for a known format without a reader; [`LogError::NoFile`] for a path that is
/// neither file nor folder.
pub fn reader(path: &Path) -> Result<&'static Reader, Error> {
    let io = |e| Error::io(path, e);
    if path.is_dir() {
        return Ok(&FOLDER);
    }
    regular(path)?;
    let mut head = Vec::with_capacity(HEAD);
    std::fs::File::open(path).map_err(io)?.take(HEAD as u64).read_to_end(&mut head).map_err(io)?;
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let ends = |extensions: &[&str]| {
        extensions.iter().any(|e| name.strip_suffix(e).is_some_and(|stem| stem.ends_with('.')))
    };
    if let Some(foreign) = FOREIGN
        .iter()
        .find(|f| head.starts_with(f.head) && (f.extensions.is_empty() || ends(f.extensions)))
    {
        let what = format!("this format is not read; {}", foreign.remedy);
        return Err(LogError::format(&path.display().to_string(), foreign.name, what).into());
    }
    let known = READERS
        .iter()
        .find(|r| (r.sniff)(&head))
        .or_else(|| READERS.iter().find(|r| ends(r.extensions)));
    known.or(READERS.last()).ok_or_else(|| io(std::io::ErrorKind::Unsupported.into()))
}

/// A file that can be read from its beginning as often as it takes.
///
/// # Errors
/// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`LogError::NoFile`] of a pipe or a device, which would be waited for.
pub(super) fn regular(path: &Path) -> Result<(), Error> {
    let there = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if there.is_file() {
        return Ok(());
    }
    Err(LogError::NoFile { file: path.display().to_string() }.into())
}

/// Reads a file of any format.
///
/// # Errors
/// [`FileError::Io`](deadtime_signal::file::FileError::Io) when the operating system refuses the file; [`super::error::LogError`] with the fault and its place.
pub fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let mut recording = (reader(path)?.open)(path, options)?;
    let Recording { topics, notes, .. } = &mut recording;
    topics.iter_mut().for_each(|topic| sentinel::missing(&mut topic.log, &options.missing, notes));
    Ok(recording)
}

/// Reads a file that holds one log: the guesses of [`open`] are not reported.
///
/// A column of text that holds no number, NaN or an infinity somewhere loads as unusable: only asking for it is an error. Time is always checked.
///
/// # Errors
/// As [`open`]; [`super::error::LogError::SeveralTopics`].
pub fn read(path: &Path) -> Result<Log, Error> {
    Ok(open(path, &ReadOptions::default())?.into_log()?)
}
