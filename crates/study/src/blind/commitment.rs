//! Commitments: a label cannot be changed once its case was handed out.
//!
//! The commitment is the hex SHA-256 of the salt's bytes followed by the label file's bytes without its salt. The salt's bytes are its text as UTF-8. The label
//! file without its salt has two readings. The first is the file with `"salt": ""` in place of `"salt": "…"`. The second is the file without the whole member:
//! its key, its value, and the comma and white space after it. For a last member they are before it. Every other byte of the file is unchanged, line ends
//! included.

use std::fmt::Write as _;
use std::ops::Range;

use sha2::{Digest, Sha256};

/// The commitments that a label file's bytes and its salt can have: by the first and by the second reading. None where the file has no salt.
#[must_use]
pub fn commitments(label: &[u8], salt: &str) -> Option<[String; 2]> {
    let member = salt_member(label)?;
    Some([member.value, member.whole].map(|cut| {
        let mut hash = Sha256::new();
        hash.update(salt.as_bytes());
        hash.update(&label[..cut.start]);
        hash.update(&label[cut.end..]);
        hash.finalize().iter().fold(String::new(), |mut text, byte| {
            // Writing to a string does not fail.
            let _ = write!(text, "{byte:02x}");
            text
        })
    }))
}

/// Whether a label file's bytes and its salt match the commitment, by either reading. None where the file has no salt.
#[must_use]
pub fn check(commitment: &str, label: &[u8], salt: &str) -> Option<bool> {
    Some(commitments(label, salt)?.iter().any(|c| c.eq_ignore_ascii_case(commitment)))
}

/// The place of the salt in a label file.
struct SaltMember {
    /// Between the quotes of its value.
    value: Range<usize>,
    /// The member with its comma.
    whole: Range<usize>,
}

/// The top-level member `salt`. The bytes are JSON (serde has read them), so following brackets and strings is enough.
fn salt_member(json: &[u8]) -> Option<SaltMember> {
    let blank = |i: usize| json.get(i).is_some_and(u8::is_ascii_whitespace);
    let skip = |mut i: usize| {
        while blank(i) {
            i += 1;
        }
        i
    };
    let (mut depth, mut i, mut comma) = (0_usize, 0, None);
    while i < json.len() {
        match json[i] {
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth = depth.saturating_sub(1),
            b',' if depth == 1 => comma = Some(i),
            b'"' => {
                let key = i;
                let end = string_end(json, i)?;
                let colon = skip(end);
                if depth == 1 && &json[key..end] == b"\"salt\"" && json.get(colon) == Some(&b':') {
                    let open = skip(colon + 1);
                    if json.get(open) != Some(&b'"') {
                        return None;
                    }
                    let close = string_end(json, open)?;
                    let after = skip(close);
                    let whole = match (json.get(after) == Some(&b','), comma) {
                        (true, _) => key..skip(after + 1),
                        (false, Some(comma)) => comma..close,
                        (false, None) => key..close,
                    };
                    return Some(SaltMember { value: open + 1..close - 1, whole });
                }
                i = end;
                continue;
            }
            _ => {}
        }
        i += 1;
    }
    None
}

/// The first byte after the string that opens at `open`.
fn string_end(json: &[u8], open: usize) -> Option<usize> {
    let mut i = open + 1;
    loop {
        match json.get(i)? {
            b'\\' => i += 2,
            b'"' => return Some(i + 1),
            _ => i += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cuts(text: &str) -> (String, String) {
        let member = salt_member(text.as_bytes()).unwrap();
        let without = |r: Range<usize>| format!("{}{}", &text[..r.start], &text[r.end..]);
        (without(member.value), without(member.whole))
    }

    #[test]
    fn salt_is_cut_out_wherever_it_stands() {
        let both = |text, first: &str, second: &str| {
            assert_eq!(cuts(text), (first.to_owned(), second.to_owned()))
        };
        both(
            "{\"id\": \"a\", \"salt\": \"xyz\", \"b\": 1}\n",
            "{\"id\": \"a\", \"salt\": \"\", \"b\": 1}\n",
            "{\"id\": \"a\", \"b\": 1}\n",
        );
        both(
            "{\n  \"salt\": \"xyz\",\n  \"b\": 1\n}",
            "{\n  \"salt\": \"\",\n  \"b\": 1\n}",
            "{\n  \"b\": 1\n}",
        );
        both(
            "{\n  \"b\": 1,\n  \"salt\": \"xyz\"\n}",
            "{\n  \"b\": 1,\n  \"salt\": \"\"\n}",
            "{\n  \"b\": 1\n}",
        );
        both("{\"salt\":\"x\\\"}\"}", "{\"salt\":\"\"}", "{}");
    }

    #[test]
    fn only_the_top_level_member_is_the_salt() {
        let text = "{\"a\": {\"salt\": \"no\"}, \"b\": \"\\\"salt\\\": \\\"no\\\"\", \"c\": [\"salt\"], \"salt\": \"yes\"}";
        assert!(cuts(text).0.ends_with("\"salt\": \"\"}"));
        assert!(salt_member(b"{\"a\": {\"salt\": \"no\"}, \"b\": \"salt\"}").is_none());
        assert!(salt_member(b"{\"salt\": null}").is_none());
    }
}
