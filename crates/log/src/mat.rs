//! MAT files of version 5 (and 6, 7): arrays, structs of arrays, Simulink's "structure with time".
//!
//! Source: MathWorks, "MAT-File Format", level 5. The content of objects (timeseries, tables) is in a part of the file that its header points to: see [`mcos`].

use std::path::Path;

use flate2::read::ZlibDecoder;

use super::arrays::{Array, assemble};
use super::budget::Budget;
use super::counted::{READING, whole};
use super::error::{Error, LogError};
use super::mcos;
use super::options::ReadOptions;
use super::recording::Recording;
use super::scalar::Scalar;
use crate::notes::Notes;
use deadtime_signal::remedy::{Message, Remedy};

const NAME: &str = "MAT 5";
const HEADER: usize = 128;
/// Structs within structs deeper than this are refused.
const DEEPEST: usize = 16;

const INT8: u32 = 1;
const UTF8: u32 = 16;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// The class of objects.
const OPAQUE: u32 = 17;

/// Whether a file begins like one of version 5; version 7.3 has the same text and another version number.
pub(super) fn is_mat5(head: &[u8]) -> bool {
    matches!(head.get(124..128), Some([0, 1, b'I', b'M'] | [1, 0, b'M', b'I']))
}

/// Reads a file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let bytes = whole(path, &options.far).map_err(|e| Error::io(path, e))?;
    read(&path.display().to_string(), &bytes, options)
}

/// Reads the bytes of a file.
pub(super) fn read(source: &str, bytes: &[u8], options: &ReadOptions) -> Result<Recording, Error> {
    let refused = |what: &str| LogError::format(source, NAME, what);
    let big = match bytes.get(124..128) {
        Some([0, 1, b'I', b'M']) => false,
        Some([1, 0, b'M', b'I']) => true,
        _ => return Err(refused("the header is not one of version 5 to 7.3 (version 4, say); save it with `save -v7` or `-v7.3`, in Python with scipy.io.savemat(FILE, data)").into()),
    };
    let budget = Budget::of(bytes.len() as u64, options);
    let how = How { big, budget: &budget };
    let mut file = Elements { bytes: bytes.get(HEADER..).unwrap_or_default(), how };
    let (mut variables, mut notes, mut objects) = (Vec::new(), Notes::default(), None);
    let subsystem = subsystem_at(bytes, big);
    let unpacking = options.far.part(READING, 1.0);
    while !file.bytes.is_empty() {
        let at = bytes.len() - file.bytes.len();
        unpacking.at(at as f64 / bytes.len() as f64, &"unpacking");
        let Some((kind, data, whole)) = file.next() else {
            notes.push(format!("cut off at byte {at}: the last variable is not whole"));
            break;
        };
        let plain = match kind {
            COMPRESSED => unpacked(data, &budget, &mut notes, (at, options.unchecked)),
            _ => Vec::new(),
        };
        let content = match kind {
            COMPRESSED => Elements { bytes: &plain, how }
                .next()
                .filter(|(kind, _, whole)| *kind == MATRIX && *whole)
                .map(|(_, content, _)| content),
            MATRIX => Some(data),
            _ => None,
        };
        if Some(at as u64) == subsystem {
            objects = content.and_then(|content| wrapper(content, how));
        } else if let Some(variable) = content.and_then(|content| matrix(content, how, 0)) {
            variables.push(variable);
        } else if matches!(kind, COMPRESSED | MATRIX) && whole && content.is_some() {
            notes.push(format!("the variable at byte {at} cannot be read; left out"));
        }
        budget.give(plain.len() as u64);
        if !whole {
            notes.push(format!(
                "cut off at byte {}: the variable that begins at byte {at} is not whole",
                bytes.len()
            ));
            break;
        }
    }
    budget.check(source)?;
    mcos::resolve(&mut variables, objects, &mut notes);
    assemble(source, "mat", NAME, variables, notes, options)
}

/// The place of the element with the content of objects.
fn subsystem_at(bytes: &[u8], big: bool) -> Option<u64> {
    let at = bytes.get(116..124)?.try_into().ok()?;
    Some(if big { u64::from_be_bytes(at) } else { u64::from_le_bytes(at) })
}

/// The cells of the `FileWrapper__`: they are in a file within an array of bytes, in the field `MCOS` of a struct.
fn wrapper(content: &[u8], how: How<'_>) -> Option<Vec<Array>> {
    let mut parts = Elements { bytes: content, how };
    // Flags, dimensions, name.
    parts.next().and(parts.next()).and(parts.next())?;
    let (_, inner, _) = parts.next()?;
    let how = How { big: inner.get(2..4)? == b"MI", ..how };
    let (_, content, _) = Elements { bytes: inner.get(8..)?, how }.next()?;
    let Array::Struct(fields) = matrix(content, how, 0)?.1 else { return None };
    match fields.into_iter().find(|(field, _)| field == "MCOS")?.1 {
        Array::List(cells) => Some(cells),
        _ => None,
    }
}

/// A compressed element; empty where it does not unpack, or its checksum does not match.
fn unpacked(
    data: &[u8],
    budget: &Budget,
    notes: &mut Notes,
    (at, unchecked): (usize, bool),
) -> Vec<u8> {
    let mut plain = Vec::new();
    let Err(error) = budget.read(ZlibDecoder::new(data), u64::MAX, &mut plain) else {
        return plain;
    };
    let what = format!("the variable at byte {at} does not unpack ({error})");
    if unchecked && error.kind() != std::io::ErrorKind::OutOfMemory {
        notes.push(format!("{what}; read as far as it goes"));
        return plain;
    }
    budget.give(plain.len() as u64);
    notes.push(match error.kind() {
        std::io::ErrorKind::OutOfMemory => budget.left_out(&format!("the variable at byte {at}")),
        _ => Message::from(format!("{what}; left out: "))
            .and(Remedy::Unchecked)
            .and(" reads it as far as it goes"),
    });
    Vec::new()
}

/// The number format of a file, and its memory limit.
#[derive(Clone, Copy)]
struct How<'b> {
    big: bool,
    budget: &'b Budget,
}

/// The elements of a part of a file.
struct Elements<'a, 'b> {
    bytes: &'a [u8],
    how: How<'b>,
}

impl<'a> Elements<'a, '_> {
    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if self.how.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// Type and content of the next element, and whether it is whole.
    fn next(&mut self) -> Option<(u32, &'a [u8], bool)> {
        let word = self.u32(0)?;
        // Up to four bytes are in the tag itself.
        if word >> 16 != 0 {
            let content = self.bytes.get(4..8)?.get(..(word >> 16) as usize)?;
            self.bytes = self.bytes.get(8..)?;
            return Some((word & 0xffff, content, true));
        }
        let length = self.u32(4)? as usize;
        let rest = self.bytes.get(8..)?;
        let content = rest.get(..length).unwrap_or(rest);
        // Compressed elements are not padded.
        let padded =
            if word == COMPRESSED { length } else { length.checked_next_multiple_of(8)? };
        self.bytes = rest.get(padded..).unwrap_or_default();
        Some((word, content, content.len() == length))
    }

    fn numbers(&mut self) -> Option<Vec<f64>> {
        let (kind, content, whole) = self.next()?;
        if !whole {
            return None;
        }
        numbers(kind, content, self.how)
    }
}

fn numbers(kind: u32, content: &[u8], how: How<'_>) -> Option<Vec<f64>> {
    let number = match kind {
        INT8 => Scalar::I8,
        2 | UTF8 => Scalar::U8,
        3 => Scalar::I16,
        4 => Scalar::U16,
        5 => Scalar::I32,
        6 => Scalar::U32,
        7 => Scalar::F32,
        9 => Scalar::F64,
        12 => Scalar::I64,
        13 => Scalar::U64,
        _ => return None,
    };
    let count = content.len() / number.size();
    // Once as they are, once as a topic's.
    if !how.budget.take(2 * size_of::<f64>() as u64 * count as u64) {
        return None;
    }
    let mut values = Vec::with_capacity(count);
    values.extend(content.chunks_exact(number.size()).filter_map(|b| number.value(b, how.big)));
    Some(values)
}

/// The given number of structs of the same fields.
fn structs(parts: &mut Elements<'_, '_>, count: usize, depth: usize) -> Option<Array> {
    let length = parts.numbers()?.first().copied()? as usize;
    let (_, names, _) = parts.next()?;
    if length == 0 {
        return Some(Array::Other);
    }
    let name_of = |bytes: &[u8]| {
        String::from_utf8_lossy(bytes.split(|b| *b == 0).next().unwrap_or_default()).into_owned()
    };
    let fields: Vec<String> = names.chunks(length).map(name_of).collect();
    let mut elements = Vec::new();
    while elements.len() < count && !parts.bytes.is_empty() && !fields.is_empty() {
        let mut element = Vec::with_capacity(fields.len());
        for field in &fields {
            let (_, value, _) = parts.next()?;
            element.push((field.clone(), matrix(value, parts.how, depth + 1)?.1));
        }
        elements.push(Array::Struct(element));
    }
    match elements.len() {
        1 => elements.pop(),
        _ => Some(Array::List(elements)),
    }
}

/// A variable: its name and its content.
fn matrix(content: &[u8], how: How<'_>, depth: usize) -> Option<(String, Array)> {
    let mut parts = Elements { bytes: content, how };
    if content.is_empty() || depth > DEEPEST {
        return Some((String::new(), Array::Other));
    }
    let (_, flags, _) = parts.next()?;
    let class = Elements { bytes: flags, how }.u32(0)? & 0xff;
    if class == OPAQUE {
        let (_, name, _) = parts.next()?;
        // The system of types, the class, and what refers to the object's properties; the wrapper's class has the properties themselves.
        parts.next().and(parts.next())?;
        let (_, content, _) = parts.next()?;
        let array = match matrix(content, how, depth + 1)?.1 {
            Array::Numbers { values, .. } => Array::Object(values),
            cells => cells,
        };
        return Some((String::from_utf8_lossy(name).into_owned(), array));
    }
    let shape: Vec<usize> = parts.numbers()?.into_iter().map(|n| n.max(0.0) as usize).collect();
    let (_, name, _) = parts.next()?;
    let name = String::from_utf8_lossy(name).into_owned();
    let count = shape.iter().try_fold(1_usize, |product, n| product.checked_mul(*n))?;
    let array = match class {
        // Cells, structs.
        1 => {
            let mut cells = Vec::new();
            while cells.len() < count && !parts.bytes.is_empty() {
                let (_, cell, _) = parts.next()?;
                cells.push(matrix(cell, how, depth + 1)?.1);
            }
            Array::List(cells)
        }
        2 => structs(&mut parts, count, depth)?,
        4 => {
            let (kind, letters, _) = parts.next()?;
            let text = match kind {
                4 | 17 => String::from_utf16_lossy(
                    &numbers(4, letters, how)?.into_iter().map(|x| x as u16).collect::<Vec<_>>(),
                ),
                _ => String::from_utf8_lossy(letters).into_owned(),
            };
            Array::Text(text)
        }
        6..=15 => {
            let values = parts.numbers()?;
            if values.len() != count {
                return None;
            }
            Array::Numbers { shape, values }
        }
        _ => Array::Other,
    };
    Some((name, array))
}
