//! Frequency responses as text: a header row, one row per frequency; columns are known by their names and units.

use std::f64::consts::TAU;
use std::io::Read;
use std::path::Path;

use nalgebra::Complex;

use super::cell::{parse, shown};
use super::lines::Lines;
use super::table::open;
use crate::error::{Error, LogError};
use crate::frequency::{FrequencyError, FrequencyResponse, Quality};
use crate::place::Place;
use deadtime_signal::progress::HowFar;

/// The role of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Frequency,
    Real,
    Imag,
    Magnitude,
    Phase,
    Coherence,
    Std,
}

/// Words by which columns are known, the more telling roles first.
const WORDS: [(Role, &str, &[&str]); 7] = [
    (Role::Coherence, "coherence", &["coherence", "coh", "cxy", "gamma2", "γ²", "γ2"]),
    (Role::Std, "standard deviation", &["std", "stddev", "sigma", "σ", "sd"]),
    (
        Role::Magnitude,
        "magnitude",
        &["magnitude", "mag", "gain", "amplitude", "modulus", "abs", "db"],
    ),
    (Role::Phase, "phase", &["phase", "angle", "arg", "deg"]),
    (Role::Real, "real part", &["real", "re"]),
    (Role::Imag, "imaginary part", &["imaginary", "imag", "im"]),
    (Role::Frequency, "frequency", &["frequency", "freq", "f", "omega", "w", "ω", "hz"]),
];

/// A column that was recognised.
struct RoleColumn {
    place: usize,
    /// The header's text.
    name: String,
    /// The words of it, in small letters.
    words: Vec<String>,
}

impl RoleColumn {
    fn has(&self, words: &[&str]) -> bool {
        self.words.iter().any(|word| words.contains(&word.as_str()))
    }

    /// The name without its unit, for a message that adds one.
    fn bare(&self) -> String {
        crate::header::name_and_unit(&self.name).0.to_owned()
    }
}

/// Words of letters and digits, in small letters.
fn words(header: &str) -> Vec<String> {
    let parts = header.split(|c: char| !(c.is_alphanumeric() || c == '°' || c == '²'));
    parts.filter(|w| !w.is_empty()).map(str::to_lowercase).collect()
}

/// Reads a frequency response from a `.csv` or `.csv.gz` file. Columns are recognised by name and unit: `frequency [Hz]` or `[rad/s]`; `real` and `imag`, or
/// `magnitude` (`[dB]`, else absolute) and `phase [deg]` or `[rad]`. Optional are `coherence` (squared) or `std` (of each part of the complex value).
///
/// # Errors
/// As [`crate::reader::read`]; [`LogError::Frequency`] where columns, units or values cannot be used.
pub fn read_frequency_response(path: &Path) -> Result<FrequencyResponse, Error> {
    read_frequency_response_from(&path.display().to_string(), open(path, &HowFar::default())?)
}

/// Reads a frequency response from any source of bytes, as [`read_frequency_response`] does.
///
/// # Errors
/// As [`read_frequency_response`].
pub fn read_frequency_response_from(
    source: &str,
    bytes: impl Read,
) -> Result<FrequencyResponse, Error> {
    let file = || source.to_owned();
    let refused = |error| Error::from(LogError::Frequency { file: source.to_owned(), error });
    let mut lines = Lines::new(source, bytes)?;
    if !lines.header()? {
        return Err(refused(FrequencyError::TooFew { needed: crate::frequency::NEEDED, found: 0 }));
    }
    let columns = columns(&lines)?;
    let existing =
        || columns.iter().map(|c| format!("`{}`", shown(c.name.as_bytes()))).collect::<Vec<_>>();
    let found = |role: Role| of_role(&columns, role).map_err(refused);
    let missing = |needed| refused(FrequencyError::NoColumn { needed, existing: existing() });
    let frequency = found(Role::Frequency)?.ok_or_else(|| missing("frequency"))?;
    let per_unit = frequency_unit(frequency).map_err(refused)?;
    let value = Form::among(&columns).map_err(refused)?.map_err(missing)?;
    let (coherence, std) = (found(Role::Coherence)?, found(Role::Std)?);
    let mut notes = vec![said(frequency, per_unit, &value, coherence, std)];
    let wanted: Vec<&RoleColumn> =
        [Some(frequency), Some(value.first), Some(value.second), coherence.or(std)]
            .into_iter()
            .flatten()
            .collect();
    let cells = lines.len();
    let (mut omega, mut values, mut more, mut places) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut empty = 0;
    while lines.next()? {
        lines.must_have(cells)?;
        let row = wanted
            .iter()
            .map(|column| number(&lines, column))
            .collect::<Result<Vec<Option<f64>>, LogError>>()?;
        if row.iter().skip(1).all(Option::is_none) {
            empty += 1;
            continue;
        }
        if let Some((column, _)) = wanted.iter().zip(&row).find(|(_, cell)| cell.is_none()) {
            let (row, column) = (lines.row, column.name.clone());
            return Err(refused(FrequencyError::EmptyCell { row, column }));
        }
        let mut row = row.into_iter().flatten();
        let (Some(f), Some(a), Some(b)) = (row.next(), row.next(), row.next()) else { continue };
        omega.push(f * per_unit);
        values.push(value.of(a, b, lines.row).map_err(refused)?);
        more.extend(row);
        places.push(Place::Row(lines.row));
    }
    notes.extend((empty > 0).then(|| format!("left out {empty} rows without a response")));
    let quality = match (coherence, std) {
        (Some(_), _) => Quality::Coherence(more),
        (None, Some(_)) => Quality::Std(more),
        (None, None) => Quality::Unknown,
    };
    Ok(FrequencyResponse::checked(file(), omega, values, quality, places)
        .map_err(refused)?
        .noting(notes))
}

/// The two columns of a complex value.
struct Form<'a> {
    first: &'a RoleColumn,
    second: &'a RoleColumn,
    /// Magnitude and phase: whether the one is in decibels, and radians per unit of the other;
    /// `None`: real and imaginary part.
    polar: Option<(bool, f64)>,
}

impl<'a> Form<'a> {
    /// The two roles among these columns; the inner error is the missing one.
    fn among(columns: &'a [RoleColumn]) -> Result<Result<Self, &'static str>, FrequencyError> {
        let found = |role: Role| of_role(columns, role);
        Ok(
            match (
                found(Role::Real)?,
                found(Role::Imag)?,
                found(Role::Magnitude)?,
                found(Role::Phase)?,
            ) {
                (Some(real), Some(imag), ..) => Ok(Self { first: real, second: imag, polar: None }),
                (_, _, Some(magnitude), Some(phase)) => {
                    let polar = Some((magnitude.has(&["db"]), phase_unit(phase)?));
                    Ok(Self { first: magnitude, second: phase, polar })
                }
                (Some(_), None, ..) => Err("imaginary part"),
                (None, Some(_), ..) => Err("real part"),
                (_, _, Some(_), None) => Err("phase"),
                _ => Err("response"),
            },
        )
    }

    fn of(&self, a: f64, b: f64, row: usize) -> Result<Complex<f64>, FrequencyError> {
        match self.polar {
            None => Ok(Complex::new(a, b)),
            Some((true, turn)) => Ok(Complex::from_polar(10.0_f64.powf(a / 20.0), b * turn)),
            Some((false, _)) if a < 0.0 => {
                let remedy = "an absolute magnitude is 0 or more; if these are decibels, write `[dB]` behind the name";
                let (place, column) = (Place::Row(row), self.first.name.clone());
                Err(FrequencyError::OutOfRange { place, column, value: a, remedy })
            }
            Some((false, turn)) => Ok(Complex::from_polar(a, b * turn)),
        }
    }
}

/// How the columns were understood.
fn said(
    frequency: &RoleColumn,
    per_unit: f64,
    &Form { first, second, polar }: &Form<'_>,
    coherence: Option<&RoleColumn>,
    std: Option<&RoleColumn>,
) -> String {
    let unit = if per_unit == 1.0 {
        "rad/s"
    } else if per_unit == TAU {
        "Hz"
    } else {
        "kHz"
    };
    let parts = match polar {
        None => format!("`{}` and `{}` as real and imaginary part", first.name, second.name),
        Some((decibels, turn)) => format!(
            "`{}` as magnitude ({}), `{}` as phase ({})",
            first.name,
            if decibels { "dB" } else { "absolute" },
            second.name,
            if turn == 1.0 { "rad" } else { "deg" }
        ),
    };
    let more = match (coherence, std) {
        (Some(column), _) => format!(", `{}` as squared coherence", column.name),
        (None, Some(column)) => format!(", `{}` as standard deviation of each part", column.name),
        (None, None) => ", nothing of the noise".to_owned(),
    };
    format!("read `{}` as frequency ({unit}), {parts}{more}", frequency.name)
}

fn columns(lines: &Lines<'_>) -> Result<Vec<RoleColumn>, LogError> {
    let text = |place| std::str::from_utf8(lines.cell(place)).map(str::to_owned);
    let column = |place| text(place).map(|name| RoleColumn { place, words: words(&name), name });
    (0..lines.len()).map(column).collect::<Result<_, _>>().map_err(|_| lines.not_text())
}

/// The role of a column: the first one in its words.
fn role(column: &RoleColumn) -> Option<Role> {
    WORDS.iter().find(|(_, _, words)| column.has(words)).map(|(role, ..)| *role)
}

/// The one column of a role.
fn of_role(columns: &[RoleColumn], wanted: Role) -> Result<Option<&RoleColumn>, FrequencyError> {
    let mut all = columns.iter().filter(|c| role(c) == Some(wanted));
    let first = all.next();
    if let (Some(first), Some(second)) = (first, all.next()) {
        let name = WORDS.iter().find(|(r, ..)| *r == wanted).map_or("", |(_, name, _)| *name);
        return Err(FrequencyError::Twice {
            role: name,
            first: first.name.clone(),
            second: second.name.clone(),
        });
    }
    Ok(first)
}

/// rad/s per unit of the column.
fn frequency_unit(column: &RoleColumn) -> Result<f64, FrequencyError> {
    if column.has(&["hz"]) {
        Ok(TAU)
    } else if column.has(&["khz"]) {
        Ok(1e3 * TAU)
    } else if column.has(&["rad", "rads", "omega", "ω", "w"]) {
        Ok(1.0)
    } else {
        Err(FrequencyError::NoUnit { column: column.bare(), units: ["Hz", "rad/s"] })
    }
}

/// Radians per unit of the column.
fn phase_unit(column: &RoleColumn) -> Result<f64, FrequencyError> {
    if column.has(&["deg", "degree", "degrees", "°"]) {
        Ok(TAU / 360.0)
    } else if column.has(&["rad", "radian", "radians"]) {
        Ok(1.0)
    } else {
        Err(FrequencyError::NoUnit { column: column.bare(), units: ["deg", "rad"] })
    }
}

/// A cell as a number; `None` where it is empty.
fn number(lines: &Lines<'_>, column: &RoleColumn) -> Result<Option<f64>, LogError> {
    let cell = lines.cell(column.place);
    parse(cell, lines.separator.allows_decimal_comma()).number(
        lines.file,
        lines.row,
        &column.name,
        cell,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<FrequencyResponse, String> {
        read_frequency_response_from("a.csv", text.as_bytes()).map_err(|e| e.to_string())
    }

    /// Eight rows of 2·e^(−0.1iω) behind a header.
    fn table(header: &str, row: impl Fn(f64) -> String) -> String {
        let rows: Vec<String> = (1..=8).map(|k| row(f64::from(k))).collect();
        format!("{header}\n{}\n", rows.join("\n"))
    }

    #[test]
    fn every_way_of_writing_a_response_is_the_same_response() {
        let tables = [
            table("omega [rad/s],real,imag", |w| {
                format!("{w},{},{}", 2.0 * (0.1 * w).cos(), -2.0 * (0.1 * w).sin())
            }),
            table("frequency [Hz],H_re,H_im", |w| {
                format!("{},{},{}", w / TAU, 2.0 * (0.1 * w).cos(), -2.0 * (0.1 * w).sin())
            }),
            table("f_hz;Magnitude (dB);Phase (deg);coherence", |w| {
                format!("{};{};{};0.9", w / TAU, 20.0 * 2.0_f64.log10(), -0.1 * w * 360.0 / TAU)
            }),
            table("freq_khz,gain,phase [rad],std", |w| {
                format!("{},2,{},0.1", w / TAU / 1e3, -0.1 * w)
            }),
        ];
        for text in tables {
            let response = read(&text).unwrap();
            for (k, (w, h)) in response.omega_rad_s().iter().zip(response.values()).enumerate() {
                let expected = k as f64 + 1.0;
                assert!((w - expected).abs() < 1e-12, "{text}");
                assert!((h - Complex::from_polar(2.0, -0.1 * expected)).norm() < 1e-12, "{text}");
            }
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_with_its_place_and_a_remedy() {
        let row = |w: f64| format!("{w},1,2");
        for (text, said) in [
            (
                table("frequency,real,imag", row),
                "a.csv: the column `frequency` says no unit; call it `frequency [Hz]` or `frequency [rad/s]`",
            ),
            (
                table("frequency [Hz],real,y", row),
                "a.csv: no column with the imaginary part; there are `frequency [Hz]`, `real`, `y`",
            ),
            (table("frequency [Hz],mag,phase", row), "call it `phase [deg]` or `phase [rad]`"),
            (table("time,u,y", row), "no column with the frequency"),
            (table("f [Hz],real,re", row), "`real` and `re` both look like the real part"),
            (
                table("f [Hz],magnitude,phase [deg]", |w| format!("{w},-3,0")),
                "row 2: `magnitude` is -3; an absolute magnitude",
            ),
            (table("f [Hz],real,imag", |w| format!("{},1,1", 9.0 - w)), "row 3: the frequency"),
            (
                table("f [Hz],real,imag,coherence", |w| format!("{w},1,1,1.2")),
                "row 2: `coherence` is 1.2; a squared coherence is between 0 and 1",
            ),
            (table("f [Hz],real,imag", |w| format!("{w},1,")), "row 2: `imag` is empty"),
            (table("f [Hz],real,imag", |w| format!("{w},1,x")), "row 2: channel `imag` holds `x`"),
            ("f [Hz],real,imag\n1,1,1\n".to_owned(), "1 frequencies above 0; at least 8"),
        ] {
            let error = read(&text).unwrap_err();
            assert!(error.contains(said), "{error}\nlacks\n{said}");
        }
    }

    #[test]
    fn the_frequency_0_is_left_out_and_said() {
        let text =
            table("f [Hz],real,imag", |w| format!("{},1,1", w)).replacen("\n", "\n0,1,0\n", 1);
        let response = read(&text).unwrap();
        assert_eq!(response.omega_rad_s().len(), 8);
        assert!(
            response.notes().iter().any(|n| n.starts_with("left out 1 rows")),
            "{:?}",
            response.notes()
        );
    }
}
