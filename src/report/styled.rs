//! Text with colours. Who has none reads the same words.

use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

use deadtime_signal::text::printed;

/// Columns that fit every terminal.
pub const WIDTH: usize = 80;

/// The role of a stretch of text, which decides its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// As it comes.
    Plain,
    /// The answer.
    Strong,
    /// A label before a sentence.
    Label,
    /// The important part.
    Counts,
    /// A warning.
    Doubt,
    /// A minor part.
    Faint,
}

impl Role {
    /// Parameters of the control sequence "select graphic rendition" (ECMA-48, 8.3.117): none but the sixteen colours, which every theme makes readable.
    fn code(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Strong => "1",
            Self::Label => "1;36",
            Self::Counts => "32",
            Self::Doubt => "33",
            Self::Faint => "2",
        }
    }
}

/// A text whose stretches have roles. Text from a file has no control over the terminal: control characters in it are shown.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Styled {
    stretches: Vec<(Role, String)>,
}

impl Styled {
    /// Adds a stretch.
    pub fn push(&mut self, role: Role, text: impl AsRef<str>) -> &mut Self {
        self.stretches.push((role, printed(text.as_ref())));
        self
    }

    /// Adds a sentence of at most `width` columns a line behind its label; further lines are indented by `indent` columns.
    pub fn sentence(
        &mut self,
        label: (Role, &str),
        text: &str,
        width: usize,
        indent: usize,
    ) -> &mut Self {
        let whole = format!("{}{text}", label.1);
        for (at, line) in wrapped(&whole, width, indent).into_iter().enumerate() {
            // A label that is wrapped itself has no colour.
            match line.strip_prefix(&*printed(label.1)).filter(|_| at == 0) {
                Some(rest) => self.push(label.0, label.1).push(Role::Plain, rest),
                None => self.push(Role::Plain, line),
            };
            self.push(Role::Plain, "\n");
        }
        self
    }

    /// Adds another text.
    pub fn append(&mut self, other: Self) -> &mut Self {
        self.stretches.extend(other.stretches);
        self
    }

    /// Without colours.
    #[must_use]
    pub fn plain(&self) -> String {
        self.stretches.iter().map(|(_, text)| text.as_str()).collect()
    }

    /// With the control sequences of colours.
    #[must_use]
    pub fn coloured(&self) -> String {
        let one = |(role, text): &(Role, String)| match role.code() {
            code if code.is_empty() || text.trim().is_empty() => text.clone(),
            code => format!("\u{1b}[{code}m{text}\u{1b}[0m"),
        };
        self.stretches.iter().map(one).collect()
    }
}

/// Columns that a text takes.
pub(in crate::report) fn columns(text: &str) -> usize {
    text.width()
}

/// The beginning of a text that takes at most so many columns, and an ellipsis where something is missing.
pub(in crate::report) fn cut(text: &str, width: usize) -> String {
    if columns(text) <= width {
        return text.to_owned();
    }
    let (begun, _) = split(text, width.saturating_sub(1));
    format!("{begun}…")
}

/// A text cut or filled with blanks to this width; flush right where wanted.
pub(in crate::report) fn cell(text: &str, width: usize, right: bool) -> String {
    let text = cut(text, width);
    let blanks = " ".repeat(width.saturating_sub(columns(&text)));
    if right { blanks + &text } else { text + &blanks }
}

/// The longest beginning of at most so many columns, at least one character, and the rest.
fn split(text: &str, width: usize) -> (&str, &str) {
    let mut taken = 0;
    let end = text.char_indices().find(|(at, c)| {
        taken += c.width().unwrap_or(0);
        taken > width && *at > 0
    });
    text.split_at(end.map_or(text.len(), |(at, _)| at))
}

/// The words of a text; a number keeps its unit.
fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let unit =
            ["%", "s", "ms", "Hz"].contains(&word.trim_end_matches([',', ';', ':', '.', ')']));
        match words.last_mut().filter(|last| unit && last.ends_with(|c: char| c.is_ascii_digit())) {
            Some(last) => *last += &format!(" {word}"),
            None => words.push(word.to_owned()),
        }
    }
    words
}

/// A paragraph as lines of at most `width` columns; all but the first are indented by `indent` columns. A word that is longer than a line is broken.
pub(in crate::report) fn wrapped(text: &str, width: usize, indent: usize) -> Vec<String> {
    // Blanks at the beginning are meant.
    let lead = &text[..text.len() - text.trim_start().len()];
    let mut lines = vec![lead.to_owned()];
    let mut empty = true;
    for word in words(&printed(text)) {
        let mut word = word.as_str();
        loop {
            let line = lines.last().map_or(0, |l| columns(l));
            let blank = usize::from(!empty);
            if line + blank + columns(word) <= width {
                if let Some(last) = lines.last_mut() {
                    last.push_str(if empty { "" } else { " " });
                    last.push_str(word);
                }
                empty = false;
                break;
            }
            if empty {
                let (first, rest) = split(word, width.saturating_sub(line));
                if let Some(last) = lines.last_mut() {
                    last.push_str(first);
                }
                word = rest;
            }
            if word.is_empty() {
                break;
            }
            lines.push(" ".repeat(indent));
            empty = true;
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn words_are_the_same_with_and_without_colour() {
        let mut text = Styled::default();
        text.sentence((Role::Label, "Cause: "), "a deadband\u{1b}[2J on `u` of the machine", 20, 2);
        assert_eq!(text.plain(), "Cause: a\n  deadband\\u{1b}[2J\n  on `u` of the\n  machine\n");
        assert!(
            text.coloured().starts_with("\u{1b}[1;36mCause: \u{1b}[0ma\n"),
            "{:?}",
            text.coloured()
        );
    }

    #[test]
    fn a_number_and_its_unit_stay_together() {
        assert_eq!(wrapped("it takes 12.4 s, 5 %", 13, 1), ["it takes", " 12.4 s, 5 %"]);
    }

    #[test]
    fn cells_have_their_width_whatever_the_script() {
        assert_eq!(
            [cell("ab", 4, false), cell("ab", 4, true), cell("abcdef", 4, false)],
            ["ab  ", "  ab", "abc…"]
        );
        assert_eq!((columns("温度"), cell("温度計", 5, false).as_str()), (4, "温度…"));
    }

    proptest! {
        #[test]
        fn no_line_is_wider_and_no_word_is_lost(text in "[a-z温é ]{0,200}", width in 8_usize..40) {
            let lines = wrapped(&text, width, 3);
            prop_assert!(lines.iter().all(|l| columns(l) <= width), "{lines:?}");
            let letters = |t: &str| t.chars().filter(|c| !c.is_whitespace()).collect::<String>();
            prop_assert_eq!(letters(&lines.concat()), letters(&text));
        }
    }
}
