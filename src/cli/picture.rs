//! Names of files that pictures are written to.

use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};

/// Extensions of pictures and documents that no program would read as SVG.
const OTHERS: [&str; 21] = [
    "apng", "avif", "bmp", "emf", "eps", "gif", "heic", "htm", "html", "ico", "jfif", "jpeg",
    "jpg", "pdf", "png", "ps", "svgz", "tif", "tiff", "webp", "wmf",
];

/// Reads the value of an option that writes SVG; every such option uses it.
pub(super) fn picture() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new()
        .try_map(|path| if let Some(why) = refusal(&path) { Err(why) } else { Ok(path) })
}

/// Why a name cannot be that of an SVG picture.
fn refusal(path: &Path) -> Option<String> {
    let extension = path.extension()?.to_str()?;
    let other = OTHERS.iter().any(|other| extension.eq_ignore_ascii_case(other));
    other.then(|| {
        format!(
            "the picture is written as SVG, not as {}: name it {}",
            extension.to_uppercase(),
            path.with_extension("svg").display()
        )
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{OTHERS, refusal};

    proptest! {
        #[test]
        fn names_of_other_kinds_are_refused_in_any_case_and_the_remedy_is_not(
            stem in "[a-zé][a-z0-9. _-]{0,12}",
            other in prop::sample::select(&OTHERS[..]),
            upper in any::<u16>(),
        ) {
            let cased = |(i, c): (usize, char)| if upper >> i & 1 == 1 { c.to_ascii_uppercase() } else { c };
            let name = format!("figures/{stem}.{}", other.chars().enumerate().map(cased).collect::<String>());
            let remedy = format!("figures/{stem}.svg");
            prop_assert_eq!(refusal(remedy.as_ref()), None);
            let said = refusal(name.as_ref()).unwrap();
            prop_assert!(said.ends_with(&remedy) && said.contains("SVG"), "{}", said);
        }
    }

    #[test]
    fn names_that_claim_no_other_kind_are_kept() {
        for name in ["a.svg", "a.SVG", "a", "png", ".png", "a.png.svg", "a.0.5", "a.png/b"] {
            assert_eq!(refusal(name.as_ref()), None, "{name}");
        }
    }
}
