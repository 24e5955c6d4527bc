//! Names that become parts of paths.

use sha2::{Digest, Sha256};

/// The longest unchanged name in bytes, and the kept bytes of a longer one.
const LONGEST: [usize; 2] = [200, 180];
/// Hexadecimal digits that distinguish names whose letters had to be replaced.
const DIGITS: usize = 8;
/// The names that Windows reserves for devices, with any extension.
const DEVICES: [&str; 22] = [
    "con", "prn", "aux", "nul", "com1", "com2", "com3", "com4", "com5", "com6", "com7", "com8",
    "com9", "lpt1", "lpt2", "lpt3", "lpt4", "lpt5", "lpt6", "lpt7", "lpt8", "lpt9",
];

/// A name from a file or a person as exactly one component of a path. The name never leads out of its folder, hides, or means an option or a device.
///
/// Letters and digits of any script, `-`, `_`, `.` and blanks inside stay; the rest becomes `_`. A name that had to be changed ends in eight digits of its SHA-256, so that
/// different names stay different.
///
/// ```
/// use deadtime_signal::file::component;
/// assert_eq!(component("thesis_2.1"), "thesis_2.1");
/// assert!(component("x/../../escaped").starts_with("x_.._.._escaped-"));
/// ```
#[must_use]
pub fn component(name: &str) -> String {
    let kept = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ');
    let [whole, cut] = LONGEST;
    let room = if name.len() > whole { cut } else { whole };
    let fits = name.char_indices().take_while(|(at, c)| at + c.len_utf8() <= room);
    let mut safe: String = fits.map(|(_, c)| if kept(c) { c } else { '_' }).collect();
    if safe.starts_with(['.', '-', ' ']) {
        safe.replace_range(..1, "_");
    }
    while safe.ends_with(['.', ' ']) {
        safe.pop();
    }
    let device = safe
        .split('.')
        .next()
        .is_some_and(|stem| DEVICES.contains(&stem.trim().to_ascii_lowercase().as_str()));
    if device || safe.is_empty() {
        safe.insert(0, '_');
    }
    if safe != name {
        let digest = Sha256::digest(name.as_bytes());
        safe.push('-');
        safe.extend(
            digest
                .iter()
                .flat_map(|b| [b >> 4, b & 15])
                .take(DIGITS)
                .filter_map(|d| char::from_digit(d.into(), 16)),
        );
    }
    safe
}

#[cfg(test)]
mod tests {
    use std::path::{Component, Path};

    use proptest::prelude::*;

    use super::component;

    #[test]
    fn plain_names_stay_and_others_stay_apart() {
        for name in ["thesis", "Björklund 2003", "a.b-c_d", "..a".trim_start_matches('.')] {
            assert_eq!(component(name), name);
        }
        let wild = [
            "",
            ".",
            "..",
            "/",
            "a/b",
            "a\\b",
            "a\0b",
            "-rf",
            ".hidden",
            "nul",
            "NUL.txt",
            "a.",
            "a ",
            "C:",
            "~\u{1b}[31m",
        ];
        let safe: Vec<String> = wild.iter().map(|n| component(n)).collect();
        for (name, safe) in wild.iter().zip(&safe) {
            assert_ne!(name, safe);
            assert!(!safe.starts_with(['.', '-']), "{safe}");
        }
        let different: std::collections::BTreeSet<&String> = safe.iter().collect();
        assert_eq!(different.len(), wild.len(), "{safe:?}");
    }

    proptest! {
        #[test]
        fn a_name_is_one_component_and_no_more(name in any::<String>()) {
            let safe = component(&name);
            let parts: Vec<Component<'_>> = Path::new(&safe).components().collect();
            prop_assert_eq!(parts, [Component::Normal(safe.as_ref())]);
            prop_assert!(safe.len() <= 255 && !safe.chars().any(char::is_control), "{}", safe);
            // A safe name is left alone.
            prop_assert_eq!(component(&safe), safe);
        }
    }
}
