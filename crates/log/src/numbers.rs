//! Numbers as narrow as a file holds them, widened when a slice of them is requested. Only few channels of a long flight are read.

use std::sync::OnceLock;

/// The number of values that are widened at once in sequential access.
const FEW: usize = 1024;

/// Numbers of one type, each of which is exactly a number of double precision.
#[derive(Debug, Clone)]
pub(super) enum Numbers {
    F64(Vec<f64>),
    F32(Vec<f32>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I8(Vec<i8>),
    U8(Vec<u8>),
}

/// The same expression for the list of each type.
macro_rules! of_each {
    ($numbers:expr, $list:ident => $what:expr) => {
        match $numbers {
            Numbers::F64($list) => $what,
            Numbers::F32($list) => $what,
            Numbers::I32($list) => $what,
            Numbers::U32($list) => $what,
            Numbers::I16($list) => $what,
            Numbers::U16($list) => $what,
            Numbers::I8($list) => $what,
            Numbers::U8($list) => $what,
        }
    };
}

/// The same expression for the list of each type, a list of that type again.
macro_rules! to_each {
    ($numbers:expr, $list:ident => $what:expr) => {
        match $numbers {
            Numbers::F64($list) => Numbers::F64($what),
            Numbers::F32($list) => Numbers::F32($what),
            Numbers::I32($list) => Numbers::I32($what),
            Numbers::U32($list) => Numbers::U32($what),
            Numbers::I16($list) => Numbers::I16($what),
            Numbers::U16($list) => Numbers::U16($what),
            Numbers::I8($list) => Numbers::I8($what),
            Numbers::U8($list) => Numbers::U8($what),
        }
    };
}

impl Numbers {
    pub(super) fn len(&self) -> usize {
        of_each!(self, list => list.len())
    }

    #[expect(clippy::useless_conversion, reason = "of each type: that of f64 is none")]
    pub(super) fn get(&self, at: usize) -> Option<f64> {
        of_each!(self, list => list.get(at).copied().map(f64::from))
    }

    /// One after the other, few at a time made wide.
    #[expect(clippy::useless_conversion, reason = "of each type: that of f64 is none")]
    pub(super) fn iter(&self) -> impl Iterator<Item = f64> {
        let wide = |from: usize| -> Vec<f64> {
            let to = self.len().min(from + FEW);
            of_each!(self, list => list.get(from..to).unwrap_or_default().iter().map(|x| f64::from(*x)).collect())
        };
        (0..self.len()).step_by(FEW).flat_map(wide)
    }

    /// Puts a number behind the others, and makes all of them wide where their type does not hold it.
    pub(super) fn push(&mut self, value: f64) {
        fn held<T: Copy>(
            list: &mut Vec<T>,
            value: f64,
            narrow: T,
            wide: impl Fn(T) -> f64,
        ) -> bool {
            let holds = wide(narrow) == value || value.is_nan() && wide(narrow).is_nan();
            if holds {
                list.push(narrow);
            }
            holds
        }
        let held = match self {
            Self::F64(list) => held(list, value, value, |x| x),
            Self::F32(list) => held(list, value, value as f32, f64::from),
            Self::I32(list) => held(list, value, value as i32, f64::from),
            Self::U32(list) => held(list, value, value as u32, f64::from),
            Self::I16(list) => held(list, value, value as i16, f64::from),
            Self::U16(list) => held(list, value, value as u16, f64::from),
            Self::I8(list) => held(list, value, value as i8, f64::from),
            Self::U8(list) => held(list, value, value as u8, f64::from),
        };
        if !held {
            let mut wide: Vec<f64> = self.iter().collect();
            wide.push(value);
            *self = Self::F64(wide);
        }
    }

    /// Removes the excess, or appends zeros.
    pub(super) fn resize(&mut self, len: usize) {
        of_each!(self, list => list.resize(len, Default::default()));
    }

    /// Puts zeros before the numbers from `at` on, so many that there are `len` in all.
    pub(super) fn move_to_end(&mut self, at: usize, len: usize) {
        of_each!(self, list => {
            let moved = list.split_off(at.min(list.len()));
            list.resize(len.saturating_sub(moved.len()), Default::default());
            list.extend(moved);
        });
    }

    /// Makes one of them 0.
    pub(super) fn clear(&mut self, at: usize) {
        of_each!(self, list => if let Some(value) = list.get_mut(at) {
            *value = Default::default();
        });
    }

    /// Those at some places, in the places' order.
    pub(super) fn picked(&self, places: &[usize]) -> Self {
        to_each!(self, list => places.iter().map(|&at| list.get(at).copied().unwrap_or_default()).collect())
    }

    /// Those from `from` on, before `to`.
    pub(super) fn part(&self, from: usize, to: usize) -> Self {
        to_each!(self, list => list.get(from..to).unwrap_or_default().to_vec())
    }

    /// The first that is not finite, from `from` on.
    pub(super) fn not_finite(&self, from: usize) -> Option<usize> {
        // A branch-free pass over all values comes first, which a processor vectorises: a value that is not finite is rare.
        fn first<T: Copy>(list: &[T], finite: impl Fn(T) -> bool) -> Option<usize> {
            let all = list.iter().fold(true, |all, x| all & finite(*x));
            if all { None } else { list.iter().position(|x| !finite(*x)) }
        }
        let bad = match self {
            Self::F64(list) => first(list.get(from..)?, f64::is_finite),
            Self::F32(list) => first(list.get(from..)?, f32::is_finite),
            _ => None,
        };
        bad.map(|at| from + at)
    }
}

/// A channel's numbers.
#[derive(Debug, Clone)]
pub(super) struct Values {
    numbers: Numbers,
    wide: OnceLock<Vec<f64>>,
}

impl Values {
    /// All of them, in double precision; made once.
    pub(super) fn wide(&self) -> &[f64] {
        match &self.numbers {
            Numbers::F64(list) => list,
            narrow => self.wide.get_or_init(|| narrow.iter().collect()),
        }
    }

    /// As the file holds them.
    pub(super) fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    /// Makes one of them 0.
    pub(super) fn clear(&mut self, at: usize) {
        self.numbers.clear(at);
        self.wide = OnceLock::new();
    }
}

impl From<Numbers> for Values {
    fn from(numbers: Numbers) -> Self {
        Self { numbers, wide: OnceLock::new() }
    }
}

impl From<Vec<f64>> for Values {
    fn from(values: Vec<f64>) -> Self {
        Numbers::F64(values).into()
    }
}

/// The same numbers, in any types.
impl PartialEq for Values {
    fn eq(&self, other: &Self) -> bool {
        self.numbers.len() == other.numbers.len()
            && self.numbers.iter().zip(other.numbers.iter()).all(|(a, b)| a == b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_type_does_not_hold_makes_all_numbers_wide_and_changes_none() {
        for (narrow, fits, beyond) in [
            (Numbers::U8(vec![7, 255]), 3.0, 256.0),
            (Numbers::I8(vec![7, -128]), -1.0, 0.5),
            (Numbers::U16(vec![65535]), 0.0, -1.0),
            (Numbers::I16(vec![-32768]), 5.0, 40000.0),
            (Numbers::U32(vec![u32::MAX]), 1.0, f64::NAN),
            (Numbers::I32(vec![i32::MIN]), -9.0, 1e10),
            (Numbers::F32(vec![0.1, f32::INFINITY]), f64::from(0.3_f32), 0.3),
        ] {
            let before: Vec<f64> = narrow.iter().collect();
            let mut grown = narrow.clone();
            grown.push(fits);
            assert_eq!(std::mem::discriminant(&grown), std::mem::discriminant(&narrow));
            grown.push(beyond);
            let after: Vec<u64> = grown.iter().map(f64::to_bits).collect();
            let meant: Vec<u64> =
                before.iter().chain(&[fits, beyond]).map(|x| x.to_bits()).collect();
            assert_eq!(after, meant);
        }
    }

    #[test]
    fn lists_are_cut_picked_and_moved_alike_whatever_their_type() {
        for numbers in [
            Numbers::F32(vec![1.0, 2.0, 3.0]),
            Numbers::F64(vec![1.0, 2.0, 3.0]),
            Numbers::I16(vec![1, 2, 3]),
        ] {
            let list = |n: &Numbers| n.iter().collect::<Vec<f64>>();
            assert_eq!(list(&numbers.picked(&[2, 0, 9])), [3.0, 1.0, 0.0]);
            assert_eq!(list(&numbers.part(1, 3)), [2.0, 3.0]);
            let mut moved = numbers.clone();
            moved.move_to_end(1, 5);
            assert_eq!(list(&moved), [1.0, 0.0, 0.0, 2.0, 3.0]);
            moved.clear(3);
            moved.resize(4);
            assert_eq!(list(&moved), [1.0, 0.0, 0.0, 0.0]);
            assert_eq!(Values::from(numbers), Values::from(vec![1.0, 2.0, 3.0]));
        }
        assert_eq!(Numbers::F32(vec![f32::NAN, 1.0, f32::INFINITY]).not_finite(1), Some(2));
    }
}
