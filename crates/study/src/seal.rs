//! A digest of a whole file inside the file. Zeros keep its place open during the writing, and the digest is filled in afterwards.

use sha2::{Digest, Sha256};

/// The digest's name in a part's footer.
const NAME: &str = "deadtime.sha256";
/// Hexadecimal digits of it.
const DIGITS: usize = 64;

/// Name and open place, to be written with the file.
pub(super) fn open() -> (&'static str, String) {
    (NAME, "0".repeat(DIGITS))
}

/// The place of the digest: after the last occurrence of its name, and the format's separators between the two.
fn place(bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    let name = bytes.windows(NAME.len()).rposition(|w| w == NAME.as_bytes())? + NAME.len();
    let after = bytes.get(name..)?;
    let start = name + after.windows(DIGITS).position(|w| w.iter().all(u8::is_ascii_hexdigit))?;
    Some(start..start + DIGITS)
}

/// The digest with the place open, for any content there.
fn digest(bytes: &[u8], place: &std::ops::Range<usize>) -> String {
    let digest = Sha256::new()
        .chain_update(bytes.get(..place.start).unwrap_or_default())
        .chain_update(open().1)
        .chain_update(bytes.get(place.end..).unwrap_or_default())
        .finalize();
    digest.iter().map(|b| format!("{b:02x}")).collect()
}

/// The file with its digest.
pub(super) fn close(mut bytes: Vec<u8>) -> Vec<u8> {
    if let Some(place) = place(&bytes) {
        let digest = digest(&bytes, &place);
        bytes.splice(place, digest.into_bytes());
    }
    bytes
}

/// Every byte is as it was written.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    place(bytes)
        .is_some_and(|place| bytes.get(place.clone()) == Some(digest(bytes, &place).as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_of_a_sealed_file_counts() {
        let text = format!("PAR1 some rows {}\u{18}@{} and an end PAR1", open().0, open().1);
        assert!(!is_whole(text.as_bytes()));
        let sealed = close(text.into_bytes());
        assert!(is_whole(&sealed));
        for at in 0..sealed.len() {
            for bit in 0..8 {
                let mut flipped = sealed.clone();
                flipped[at] ^= 1 << bit;
                assert!(!is_whole(&flipped), "byte {at}, bit {bit}");
            }
            assert!(!is_whole(&sealed[..at]), "cut at {at}");
        }
        assert!(!is_whole(&[&sealed[..], b"x"].concat()));
    }
}
