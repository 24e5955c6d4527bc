//! Text in UTF-16, as programs of Windows write it, read as UTF-8.

use std::io::{Read, Result};

/// Makes a unit of two bytes.
type Unit = fn([u8; 2]) -> u16;

/// The byte order of a file that begins with the byte order mark of UTF-16.
pub(super) fn byte_order(first: &[u8]) -> Option<Unit> {
    match first {
        [0xff, 0xfe, ..] => Some(u16::from_le_bytes),
        [0xfe, 0xff, ..] => Some(u16::from_be_bytes),
        _ => None,
    }
}

/// A source of UTF-16, as UTF-8; its mark too. Invalid characters become the replacement character.
pub(super) struct Utf16<R> {
    inner: R,
    unit: Unit,
    /// The first byte of a unit, the first unit of a pair.
    half: Option<u8>,
    high: Option<u16>,
    out: Vec<u8>,
    at: usize,
}

impl<R: Read> Utf16<R> {
    pub(super) fn new(inner: R, unit: Unit) -> Self {
        Self { inner, unit, half: None, high: None, out: Vec::new(), at: 0 }
    }

    fn push(&mut self, unit: u16) {
        let high = self.high.take();
        if high.is_none() && (0xd800..0xdc00).contains(&unit) {
            self.high = Some(unit);
            return;
        }
        for character in char::decode_utf16(high.into_iter().chain([unit])) {
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            self.out.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
        }
    }
}

impl<R: Read> Read for Utf16<R> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize> {
        while self.at == self.out.len() {
            self.out.clear();
            self.at = 0;
            let mut chunk = [0; 1 << 13];
            let read = self.inner.read(&mut chunk)?;
            if read == 0 {
                return Ok(0);
            }
            for byte in chunk.into_iter().take(read) {
                match self.half.take() {
                    None => self.half = Some(byte),
                    Some(first) => self.push((self.unit)([first, byte])),
                }
            }
        }
        let read = self.out.get(self.at..).unwrap_or_default().read(into)?;
        self.at += read;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Witness: the standard library's encoder.
    #[test]
    fn text_comes_back_whatever_the_byte_order_and_however_it_is_cut() {
        let text = "\u{feff}time;Größe [°C];🚁\n0;1;2\n";
        for (to_bytes, mark) in [
            (u16::to_le_bytes as fn(u16) -> [u8; 2], [0xff, 0xfe]),
            (u16::to_be_bytes, [0xfe, 0xff]),
        ] {
            let bytes: Vec<u8> = text.encode_utf16().flat_map(to_bytes).collect();
            assert!(bytes.starts_with(&mark));
            let unit = byte_order(&bytes).unwrap();
            for cut in [1, 3, 17, bytes.len()] {
                let (first, rest) = bytes.split_at(cut.min(bytes.len()));
                let mut back = String::new();
                Utf16::new(first.chain(rest), unit).read_to_string(&mut back).unwrap();
                assert_eq!(back, text);
            }
        }
        assert!(byte_order(b"time").is_none() && byte_order(b"\xff").is_none());
    }
}
