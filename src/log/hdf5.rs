//! HDF5 files, and MAT 7.3, which is HDF5: vectors and matrices beside a vector of time, groups (structs) as topics.
//!
//! Source: the HDF5 format, by the crate `hdf5-reader`. MATLAB writes its arrays column by column, so that the dimensions stand the other way round; other programs do not.
//! MATLAB's objects and cells refer to arrays elsewhere in the file: they are named and left out.

use std::path::Path;

use hdf5_reader::error::Error as Damage;
use hdf5_reader::group::Group;
use hdf5_reader::{Dataset, Datatype, Hdf5File};

use super::LogError;
use super::arrays::{Array, assemble};
use super::columns::guarded;
use super::counted::{READING, whole};
use super::recording::{ReadOptions, Recording};
use crate::error::Error;

const NAME: &str = "HDF5";
/// Groups within groups deeper than this are left out: a file may hold itself.
const DEEPEST: usize = 16;
/// MATLAB's word for what an array was.
const CLASS: &str = "MATLAB_class";

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let bytes = whole(path, &options.far).map_err(|e| Error::io(path, e))?;
    options.far.at(READING, &"unpacking");
    let mut notes = Vec::new();
    let root = || Hdf5File::from_vec(bytes)?.root_group();
    let variables = root().map(|group| variables(&group, "", 0, &mut notes)).map_err(|e| LogError::Format {
        file: source.to_owned(),
        format: NAME,
        what: e.to_string(),
    })?;
    assemble(source, "hdf5", NAME, variables, notes, options)
}

/// The arrays and groups of a group.
fn variables(group: &Group, path: &str, depth: usize, notes: &mut Vec<String>) -> Vec<(String, Array)> {
    let (groups, arrays) = match group.members() {
        Ok(members) => members,
        Err(error) => {
            notes.push(format!("{}: damaged ({error}); left out", if path.is_empty() { "the root" } else { path }));
            return Vec::new();
        }
    };
    let mut found = Vec::new();
    for array in arrays {
        let (name, full) = (array.name().to_owned(), join(path, array.name()));
        match numbers(&array) {
            Ok(Some(numbers)) => found.push((name, numbers)),
            Ok(None) => notes.push(format!("{full}: no numbers; left out")),
            Err(error) => notes.push(format!("{full}: damaged ({error}); left out")),
        }
    }
    for inner in groups {
        // MATLAB keeps there what cells and objects refer to.
        if inner.name().starts_with('#') {
            notes.push(format!("{}: cells and objects; left out", join(path, inner.name())));
        } else if depth < DEEPEST {
            let fields = variables(&inner, &join(path, inner.name()), depth + 1, notes);
            found.push((inner.name().to_owned(), Array::Struct(fields)));
        }
    }
    found
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// An array of numbers column by column; `None` of anything else.
fn numbers(array: &Dataset) -> Result<Option<Array>, Damage> {
    let class = array.attribute(CLASS).and_then(|a| a.read_string()).ok();
    if class.as_deref().is_some_and(|c| matches!(c.trim_end_matches('\0'), "char" | "cell" | "struct" | "function_handle")) {
        return Ok(None);
    }
    let Some((kind, size)) = scalar(array.dtype()) else { return Ok(None) };
    let bytes = array.read_native_bytes()?;
    let values: Vec<f64> = bytes.chunks_exact(size).map(|b| kind.value(b)).collect();
    let mut shape = Vec::with_capacity(array.ndim());
    for length in array.shape() {
        shape.push(usize::try_from(*length).unwrap_or(usize::MAX));
    }
    if class.is_some() {
        shape.reverse();
        return Ok(Some(Array::Numbers { shape, values }));
    }
    let rows = shape.first().copied().unwrap_or(0);
    let columns = values.len().checked_div(rows).unwrap_or(0);
    let places = (0..columns).flat_map(|j| (0..rows).map(move |k| k * columns + j));
    let turned = if columns > 1 { places.filter_map(|at| values.get(at)).copied().collect() } else { values };
    Ok(Some(Array::Numbers { shape, values: turned }))
}

/// A number of the machine's byte order.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Signed,
    Unsigned,
    Float,
}

impl Kind {
    fn value(self, bytes: &[u8]) -> f64 {
        fn exact<const N: usize>(bytes: &[u8]) -> [u8; N] {
            bytes.try_into().unwrap_or([0; N])
        }
        match (self, bytes.len()) {
            (Self::Signed, 1) => f64::from(i8::from_ne_bytes(exact(bytes))),
            (Self::Signed, 2) => f64::from(i16::from_ne_bytes(exact(bytes))),
            (Self::Signed, 4) => f64::from(i32::from_ne_bytes(exact(bytes))),
            (Self::Signed, _) => i64::from_ne_bytes(exact(bytes)) as f64,
            (Self::Unsigned, 1) => f64::from(u8::from_ne_bytes(exact(bytes))),
            (Self::Unsigned, 2) => f64::from(u16::from_ne_bytes(exact(bytes))),
            (Self::Unsigned, 4) => f64::from(u32::from_ne_bytes(exact(bytes))),
            (Self::Unsigned, _) => u64::from_ne_bytes(exact(bytes)) as f64,
            (Self::Float, 4) => f64::from(f32::from_ne_bytes(exact(bytes))),
            (Self::Float, _) => f64::from_ne_bytes(exact(bytes)),
        }
    }
}

/// What one number is, and its bytes.
fn scalar(kind: &Datatype) -> Option<(Kind, usize)> {
    match kind {
        Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), signed: true, .. } => Some((Kind::Signed, usize::from(*size))),
        Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), signed: false, .. } => Some((Kind::Unsigned, usize::from(*size))),
        Datatype::FloatingPoint { size: size @ (4 | 8), .. } => Some((Kind::Float, usize::from(*size))),
        // Truth values of h5py.
        Datatype::Enum { base, .. } => scalar(base),
        _ => None,
    }
}
