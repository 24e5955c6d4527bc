//! One number as a file holds it, of either byte order.

use super::numbers::Numbers;

/// The type of a number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Its bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at the beginning of these bytes; `big`: the most significant one comes first.
    pub(super) fn value(self, bytes: &[u8], big: bool) -> Option<f64> {
        macro_rules! number {
            ($number:ty) => {{
                let mut bytes = *bytes.first_chunk()?;
                if big {
                    bytes.reverse();
                }
                <$number>::from_le_bytes(bytes)
            }};
        }
        Some(match self {
            Self::I8 => f64::from(number!(i8)),
            Self::U8 => f64::from(number!(u8)),
            Self::I16 => f64::from(number!(i16)),
            Self::U16 => f64::from(number!(u16)),
            Self::I32 => f64::from(number!(i32)),
            Self::U32 => f64::from(number!(u32)),
            Self::I64 => number!(i64) as f64,
            Self::U64 => number!(u64) as f64,
            Self::F32 => f64::from(number!(f32)),
            Self::F64 => number!(f64),
        })
    }

    /// The number at a place, the least significant byte first.
    pub(super) fn at(self, bytes: &[u8], at: usize) -> Option<f64> {
        self.value(bytes.get(at..)?, false)
    }

    /// No numbers yet, of the type that holds these exactly.
    pub(super) fn none(self) -> Numbers {
        match self {
            Self::I8 => Numbers::I8(Vec::new()),
            Self::U8 => Numbers::U8(Vec::new()),
            Self::I16 => Numbers::I16(Vec::new()),
            Self::U16 => Numbers::U16(Vec::new()),
            Self::I32 => Numbers::I32(Vec::new()),
            Self::U32 => Numbers::U32(Vec::new()),
            Self::F32 => Numbers::F32(Vec::new()),
            Self::I64 | Self::U64 | Self::F64 => Numbers::F64(Vec::new()),
        }
    }

    /// The number at `at` of each of the messages of one size, to the end of a list.
    pub(super) fn each(self, messages: &[u8], size: usize, at: usize, into: &mut Numbers) {
        fn all<T, const N: usize>(
            messages: &[u8],
            size: usize,
            at: usize,
            into: &mut Vec<T>,
            number: impl Fn([u8; N]) -> T,
        ) {
            let one = |message: &[u8]| {
                message.get(at..).and_then(|m| m.first_chunk()).copied().unwrap_or([0; N])
            };
            into.extend(messages.chunks_exact(size.max(1)).map(|message| number(one(message))));
        }
        match (self, into) {
            (Self::I8, Numbers::I8(list)) => all(messages, size, at, list, i8::from_le_bytes),
            (Self::U8, Numbers::U8(list)) => all(messages, size, at, list, u8::from_le_bytes),
            (Self::I16, Numbers::I16(list)) => all(messages, size, at, list, i16::from_le_bytes),
            (Self::U16, Numbers::U16(list)) => all(messages, size, at, list, u16::from_le_bytes),
            (Self::I32, Numbers::I32(list)) => all(messages, size, at, list, i32::from_le_bytes),
            (Self::U32, Numbers::U32(list)) => all(messages, size, at, list, u32::from_le_bytes),
            (Self::F32, Numbers::F32(list)) => all(messages, size, at, list, f32::from_le_bytes),
            (Self::U64, Numbers::F64(list)) => {
                all(messages, size, at, list, |b| u64::from_le_bytes(b) as f64)
            }
            (Self::F64, Numbers::F64(list)) => all(messages, size, at, list, f64::from_le_bytes),
            // The column began with another type.
            (kind, list) => messages
                .chunks_exact(size.max(1))
                .filter_map(|message| kind.at(message, at))
                .for_each(|x| list.push(x)),
        }
    }
}
