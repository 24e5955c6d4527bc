//! HDF5 files, and MAT 7.3, which is HDF5: vectors and matrices with a vector of time, groups (structs) as topics.
//!
//! Source: the HDF5 format, by the crate `hdf5-reader`. MATLAB writes its arrays column by column, so that the dimensions are reversed; other programs do not.
//! MATLAB's cells, arrays of structs and objects refer to arrays in the group `#refs#`.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use hdf5_reader::error::Error as Damage;
use hdf5_reader::filters::{FILTER_FLETCHER32, FilterRegistry};
use hdf5_reader::group::Group;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::reference::read_object_references;
use hdf5_reader::{Dataset, Datatype, Hdf5File, OpenOptions};

use super::arrays::{Array, assemble};
use super::budget::Budget;
use super::counted::{READING, whole};
use super::error::{Error, LogError};
use super::guard::guarded;
use super::mcos;
use super::options::ReadOptions;
use super::recording::Recording;
use super::scalar::Scalar;
use crate::notes::Notes;

const NAME: &str = "HDF5";
/// Groups within groups deeper than this are left out: a file may hold itself.
const DEEPEST: usize = 16;
/// No array holds more bytes than this many times the file's: deflate packs no better.
const MOST_PACKED: usize = 1032;
/// MATLAB's name of the class of an array.
const CLASS: &str = "MATLAB_class";
/// The mark of an array without elements, which holds its dimensions instead.
const EMPTY: &str = "MATLAB_empty";
/// Of numbers that refer to an object: 3.
const DECODE: &str = "MATLAB_object_decode";

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let bytes = whole(path, &options.far).map_err(|e| Error::io(path, e))?;
    options.far.at(READING, &"unpacking");
    let budget = Budget::of(bytes.len() as u64, options);
    let mut parts = Parts { length: bytes.len(), budget: budget.clone(), ..Parts::default() };
    let most = bytes
        .len()
        .saturating_mul(MOST_PACKED)
        .min(usize::try_from(budget.limit()).unwrap_or(usize::MAX));
    let mut limits = OpenOptions::default().with_max_read_bytes(most);
    if options.unchecked {
        limits.filter_registry = Some(unchecked());
    }
    limits.max_chunk_bytes = limits.max_chunk_bytes.min(most);
    let root = || Hdf5File::from_vec_with_options(bytes, limits)?.root_group();
    let (mut variables, objects) = root()
        .map(|group| parts.file(&group))
        .map_err(|e| LogError::format(source, NAME, e.to_string()))?;
    mcos::resolve(&mut variables, objects, &mut parts.notes);
    assemble(source, "hdf5", NAME, variables, parts.notes, options)
}

/// Filters that take a checksum off without looking at it.
fn unchecked() -> FilterRegistry {
    const CHECKSUM: usize = 4;
    let mut filters = FilterRegistry::new();
    let strip = |_: &FilterDescription, data: &[u8], _: usize| {
        Ok(data.get(..data.len().saturating_sub(CHECKSUM)).unwrap_or_default().to_vec())
    };
    filters.register(FILTER_FLETCHER32, Box::new(strip));
    filters
}

/// The target of a cell.
enum Referred {
    Group(Group),
    Array(Box<Dataset>),
}

/// The parts of a file while it is read.
#[derive(Default)]
struct Parts {
    /// The file's bytes.
    length: usize,
    budget: Budget,
    /// Groups that were read: a file may hold itself.
    groups: HashSet<u64>,
    /// The unread targets of cells, by their place: each is read once, so that no file holds itself.
    referred: HashMap<u64, Referred>,
    read: HashSet<u64>,
    notes: Notes,
}

impl Parts {
    /// The variables, and what MATLAB's objects refer to.
    fn file(&mut self, root: &Group) -> (Vec<(String, Array)>, Option<Vec<Array>>) {
        if let Ok(group) = root.group("#refs#") {
            match group.members() {
                Ok((groups, arrays)) => {
                    self.referred.extend(
                        groups.into_iter().map(|group| (group.address(), Referred::Group(group))),
                    );
                    self.referred.extend(
                        arrays
                            .into_iter()
                            .map(|array| (array.address(), Referred::Array(Box::new(array)))),
                    );
                }
                Err(error) => self.notes.push(format!(
                    "cells, arrays of structs and objects: damaged ({error}); left out"
                )),
            }
        }
        let variables = self.group(root, "", 0);
        let wrapper = root.group("#subsystem#").and_then(|group| group.dataset("MCOS"));
        let cells = wrapper.ok().and_then(|wrapper| self.cells(&wrapper, "#subsystem#", 0).ok());
        (variables, cells)
    }

    /// The arrays and groups of a group.
    fn group(&mut self, group: &Group, path: &str, depth: usize) -> Vec<(String, Array)> {
        if !self.groups.insert(group.address()) {
            self.notes.push(format!("{path}: another name of a group that was read; left out"));
            return Vec::new();
        }
        let (groups, arrays) = match group.members() {
            Ok(members) => members,
            Err(error) => {
                self.notes.push(format!(
                    "{}: damaged ({error}); left out",
                    if path.is_empty() { "the root" } else { path }
                ));
                return Vec::new();
            }
        };
        let mut found = Vec::new();
        for array in arrays {
            let (name, full) = (array.name().to_owned(), join(path, array.name()));
            found.extend(self.array(&array, &full, depth).map(|array| (name, array)));
        }
        for inner in groups {
            // MATLAB keeps there what cells and objects refer to.
            if depth < DEEPEST && !inner.name().starts_with('#') {
                let fields = self.structure(&inner, &join(path, inner.name()), depth + 1);
                found.push((inner.name().to_owned(), fields));
            }
        }
        found
    }

    /// A struct, or several of the same fields, which are cells then.
    fn structure(&mut self, group: &Group, path: &str, depth: usize) -> Array {
        let several = group.attribute(CLASS).is_ok()
            && group.members().is_ok_and(|(groups, arrays)| {
                groups.is_empty()
                    && !arrays.is_empty()
                    && arrays
                        .iter()
                        .all(|array| is_reference(array) && array.attribute(CLASS).is_err())
            });
        let fields = self.group(group, path, depth);
        if !several {
            return Array::Struct(fields);
        }
        let mut elements: Vec<Vec<(String, Array)>> = Vec::new();
        for (name, field) in fields {
            let Array::List(values) = field else { continue };
            elements.resize_with(elements.len().max(values.len()), Vec::new);
            for (element, value) in elements.iter_mut().zip(values) {
                element.push((name.clone(), value));
            }
        }
        Array::List(elements.into_iter().map(Array::Struct).collect())
    }

    /// An array; an unusable array gets a note.
    fn array(&mut self, array: &Dataset, path: &str, depth: usize) -> Option<Array> {
        let matlab = !(self.referred.is_empty() && self.read.is_empty());
        let read = match is_reference(array) && matlab {
            true => self.cells(array, path, depth).map(|cells| Some(Array::List(cells))),
            false => self.fits(array).and_then(|()| {
                // Once in the file's type, once as numbers.
                let count = array.shape().iter().fold(1_u64, |n, length| n.saturating_mul(*length));
                let bytes = (array.raw_byte_len()? as u64).saturating_add(count.saturating_mul(8));
                if scalar(array.dtype()).is_some() && !self.budget.spare(bytes) {
                    self.notes.push(self.budget.left_out(path));
                    return Ok(Some(Array::Other));
                }
                numbers(array)
            }),
        };
        match read {
            Ok(Some(read)) => return Some(read),
            Ok(None) => self.notes.push(format!("{path}: no numbers; left out")),
            Err(error) => self.notes.push(format!("{path}: damaged ({error}); left out")),
        }
        None
    }

    /// Unpacked data are in the file.
    fn fits(&self, array: &Dataset) -> Result<(), Damage> {
        if array.chunks().is_none() && array.raw_byte_len()? > self.length {
            return Err(Damage::Other("it is larger than the file".into()));
        }
        Ok(())
    }

    /// The targets of an array of references.
    fn cells(&mut self, array: &Dataset, path: &str, depth: usize) -> Result<Vec<Array>, Damage> {
        if depth >= DEEPEST {
            return Ok(Vec::new());
        }
        self.fits(array)?;
        let bytes = array.read_raw_bytes()?;
        let places = read_object_references(&bytes, 8)?;
        let mut found = Vec::with_capacity(places.len());
        for (k, place) in places.into_iter().enumerate() {
            let path = format!("{path}[{}]", k + 1);
            found.push(match self.referred.remove(&place) {
                Some(Referred::Group(group)) => self.structure(&group, &path, depth + 1),
                Some(Referred::Array(array)) => {
                    // Empty cells share one array.
                    if array.attribute(EMPTY).is_err() {
                        self.read.insert(place);
                    }
                    self.array(&array, &path, depth + 1).unwrap_or(Array::Other)
                }
                None => {
                    if self.read.contains(&place) {
                        self.notes
                            .push(format!("{path}: refers to what another cell holds; left out"));
                    }
                    Array::Other
                }
            });
        }
        Ok(found)
    }
}

/// Whether an array has places in the file as its elements.
fn is_reference(array: &Dataset) -> bool {
    matches!(array.dtype(), Datatype::Reference { size: 8, .. }) && array.attribute(EMPTY).is_err()
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// An array of numbers column by column, letters, or what refers to an object; `None` of anything else.
fn numbers(array: &Dataset) -> Result<Option<Array>, Damage> {
    let class = array.attribute(CLASS).and_then(|a| a.read_string()).ok();
    let class = class.as_deref().map(|c| c.trim_end_matches('\0'));
    if array.attribute(EMPTY).is_ok() {
        return Ok(Some(Array::Other));
    }
    if matches!(class, Some("cell" | "struct" | "function_handle")) {
        return Ok(None);
    }
    let Some((number, stride)) = scalar(array.dtype()) else { return Ok(None) };
    let bytes = array.read_native_bytes()?;
    let big = cfg!(target_endian = "big");
    let values: Vec<f64> =
        bytes.chunks_exact(stride).filter_map(|b| number.value(b, big)).collect();
    if class == Some("char") {
        return Ok(Some(Array::Text(String::from_utf16_lossy(
            &values.iter().map(|x| *x as u16).collect::<Vec<_>>(),
        ))));
    }
    if array.attribute(DECODE).is_ok() && mcos::refers(&values) {
        return Ok(Some(Array::Object(values)));
    }
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
    let turned = if columns > 1 {
        places.filter_map(|at| values.get(at)).copied().collect()
    } else {
        values
    };
    Ok(Some(Array::Numbers { shape, values: turned }))
}

/// The type of one number, and its distance in bytes to the next: of complex numbers the real part is read.
fn scalar(kind: &Datatype) -> Option<(Scalar, usize)> {
    let plain = match kind {
        Datatype::FixedPoint { size: 1, signed: true, .. } => Scalar::I8,
        Datatype::FixedPoint { size: 1, signed: false, .. } => Scalar::U8,
        Datatype::FixedPoint { size: 2, signed: true, .. } => Scalar::I16,
        Datatype::FixedPoint { size: 2, signed: false, .. } => Scalar::U16,
        Datatype::FixedPoint { size: 4, signed: true, .. } => Scalar::I32,
        Datatype::FixedPoint { size: 4, signed: false, .. } => Scalar::U32,
        Datatype::FixedPoint { size: 8, signed: true, .. } => Scalar::I64,
        Datatype::FixedPoint { size: 8, signed: false, .. } => Scalar::U64,
        Datatype::FloatingPoint { size: 4, .. } => Scalar::F32,
        Datatype::FloatingPoint { size: 8, .. } => Scalar::F64,
        // Truth values of h5py.
        Datatype::Enum { base, .. } => return scalar(base),
        Datatype::Compound { size, fields } => match fields.as_slice() {
            [real, imaginary]
                if real.name == "real" && real.byte_offset == 0 && imaginary.name == "imag" =>
            {
                let (number, _) = scalar(&real.datatype)?;
                return Some((number, (*size as usize).max(number.size())));
            }
            _ => return None,
        },
        _ => return None,
    };
    Some((plain, plain.size()))
}
