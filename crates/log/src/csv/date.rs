//! Dates and times of day as files write them.

/// Nanoseconds of a day.
pub(super) const DAY_NS: i128 = 86_400_000_000_000;

/// Whether a date has a time zone.
pub(super) fn zoned(text: &str) -> bool {
    let clock = text.trim().split_once(['T', 't', ' ']).map_or("", |(_, clock)| clock);
    let (lower, sign) = (clock.to_lowercase(), clock.contains(['+', '-']));
    sign || ["z", "utc", "gmt"].iter().any(|zone| lower.ends_with(zone))
}

/// Whether a cell is two numbers with a colon between them: hours and minutes, or minutes and seconds.
pub(super) fn is_half_a_clock(text: &str) -> bool {
    let mut parts = text.trim().split(':');
    let mut number = || parts.next().and_then(|part| part.replace(',', ".").parse::<f64>().ok());
    number().is_some() && number().is_some() && parts.next().is_none()
}

/// Nanoseconds since midnight of `HH:MM:SS`, with a fraction or AM or PM.
pub(super) fn clock_only(text: &str) -> Option<i128> {
    time_of_day(text.trim()).filter(|_| text.bytes().filter(|b| *b == b':').count() == 2)
}
/// The day and the time of day of a date, without what German writes around them: `01.03.2024, 12:30 Uhr`.
pub(super) fn day_and_clock(text: &str) -> (&str, Option<&str>) {
    let text = text.trim();
    match text.split_once(['T', 't', ' ']) {
        Some((day, clock)) => {
            let clock = clock.trim();
            let clock = clock.strip_suffix("Uhr").map_or(clock, str::trim_end);
            (day.strip_suffix(',').unwrap_or(day), Some(clock))
        }
        None => (text, None),
    }
}

/// The year of two digits, by POSIX (`strptime`, %y): 69 to 99 are of the last century.
pub(super) fn century(two: i128) -> i128 {
    if two < 69 { 2000 + two } else { 1900 + two }
}

/// Day and time of day of a date of digits alone, `20240301123001`. A count of micro- or nanoseconds has as many digits; of such counts one in 20 000 is a date.
pub(super) fn all_digits(text: &str) -> Option<(&str, &str)> {
    let text = text.trim();
    let (day, clock) = text.split_at_checked(8)?;
    let there = text.len() == 14
        && text.bytes().all(|b| b.is_ascii_digit())
        && (1980..2100).contains(&day.get(..4)?.parse::<i128>().ok()?)
        && date(&format!("{day}T{clock}")).is_some();
    there.then_some((day, clock))
}

/// Months by their first three letters, English or German.
pub(super) const MONTHS: [&[&str]; 12] = [
    &["jan"],
    &["feb"],
    &["mar", "mär", "mrz"],
    &["apr"],
    &["may", "mai"],
    &["jun"],
    &["jul"],
    &["aug"],
    &["sep"],
    &["oct", "okt"],
    &["nov"],
    &["dec", "dez"],
];

/// A date with the name of its month as `YYYY-MM-DD` and its time of day: `13-Feb-2026 10:00:00`, `13. Februar 2026`, `Feb 13, 2026 1:00 PM`.
pub(super) fn with_name_of_month(text: &str) -> Option<String> {
    if text.bytes().filter(u8::is_ascii_alphabetic).count() < 2 {
        return None;
    }
    let ends = |c: char| matches!(c, ' ' | '-' | ',' | '/' | '.');
    let (mut rest, mut parts) = (text.trim(), Vec::with_capacity(3));
    while parts.len() < 3 {
        let at = rest.find(ends).unwrap_or(rest.len());
        let (part, behind) = rest.split_at_checked(at)?;
        parts.push(part);
        rest = behind.trim_start_matches(ends);
        if rest.is_empty() {
            break;
        }
    }
    let month = |part: &str| {
        let start: String = part.chars().take(3).flat_map(char::to_lowercase).collect();
        let letters = part.chars().all(char::is_alphabetic);
        MONTHS.iter().position(|names| letters && names.contains(&start.as_str())).map(|at| at + 1)
    };
    let (day, month, year) = match parts.as_slice() {
        [day, name, year] if month(name).is_some() => (day, month(name)?, year),
        [name, day, year] => (day, month(name)?, year),
        _ => return None,
    };
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    let there = digits(day) && (1..=2).contains(&day.len()) && digits(year) && year.len() == 4;
    there.then(|| format!("{year}-{month:02}-{day:0>2} {rest}").trim_end().to_owned())
}

/// Nanoseconds since 1970 of a date by ISO 8601: `2024-03-01`, `2024-03-01T12:30:01.25Z`, `2024-03-01 12:30:01,25+01:00`, `20240301T123001Z`; also `01.03.2024 12:30`, `1.3.24`,
/// `1-Mar-2024`, `20240301123001` and `12:30:01 PM`.
/// Without a zone it is taken as UTC.
pub(super) fn date(text: &str) -> Option<i128> {
    if let Some((day, clock)) = all_digits(text) {
        return date(&format!("{day}T{clock}"));
    }
    if let Some(text) = with_name_of_month(text) {
        return date(&text);
    }
    let (day, clock) = day_and_clock(text);
    let digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    let compact = day.len() == 8 && digits(day) && clock.is_some();
    let (year, month, of_month) = if compact {
        (day.get(..4)?, day.get(4..6)?, day.get(6..)?)
    } else {
        let mut parts = day.split(['-', '/', '.']);
        let three = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() {
            return None;
        }
        // Points separate day, month and year, in this order.
        if day.contains('.') { (three.2, three.1, three.0) } else { three }
    };
    let part = |text: &str, least: usize, most: usize| {
        (digits(text) && (least..=most).contains(&text.len())).then(|| text.parse().ok())?
    };
    let points = day.contains('.');
    let least = if points { 1 } else { 2 };
    let short = points && year.len() == 2;
    let (year, month, of_month): (i128, i128, i128) = (
        part(year, if short { 2 } else { 4 }, 4)?,
        part(month, least, 2)?,
        part(of_month, least, 2)?,
    );
    let year = if short { century(year) } else { year };
    if !(1..=12).contains(&month) || !(1..=31).contains(&of_month) {
        return None;
    }
    let seconds_ns = match clock {
        None => 0,
        Some(clock) if compact => time_of_day(&spread(clock)?)?,
        Some(clock) => time_of_day(clock)?,
    };
    Some(days(year, month, of_month) * DAY_NS + seconds_ns)
}

/// `123001.5Z` as `12:30:01.5Z`.
pub(super) fn spread(clock: &str) -> Option<String> {
    if clock.contains(':') {
        return Some(clock.to_owned());
    }
    let (hours, rest) = clock.split_at_checked(2)?;
    let (minutes, rest) = rest.split_at_checked(2)?;
    let seconds = rest.starts_with(|c: char| c.is_ascii_digit());
    Some(format!("{hours}:{minutes}{}{rest}", if seconds { ":" } else { "" }))
}

/// Days since 1970 in the Gregorian calendar: years begin in March, so that the leap day is a year's last.
pub(super) fn days(year: i128, month: i128, of_month: i128) -> i128 {
    let year = if month <= 2 { year - 1 } else { year };
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + of_month - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Nanoseconds of an hour.
pub(super) const HOUR_NS: i128 = 3_600_000_000_000;

/// Nanoseconds of `HH:MM`, `HH:MM:SS`, `HH:MM:SS.fraction` with or without a zone.
pub(super) fn time_of_day(text: &str) -> Option<i128> {
    let half = |end: &[&str]| end.iter().find_map(|end| text.strip_suffix(end));
    let halves = [half(&["AM", "am", "a.m."]), half(&["PM", "pm", "p.m."])];
    for (at, clock) in halves.into_iter().enumerate() {
        let Some(clock) = clock.map(str::trim_end) else { continue };
        // Twelve comes before one.
        let ns = time_of_day(clock).filter(|ns| (HOUR_NS..13 * HOUR_NS).contains(ns))?;
        return Some(ns % (12 * HOUR_NS) + at as i128 * 12 * HOUR_NS);
    }
    let utc = text
        .strip_suffix(['Z', 'z'])
        .or_else(|| text.strip_suffix("UTC"))
        .or_else(|| text.strip_suffix("GMT"));
    let (clock, zone_min) = if let Some(clock) = utc {
        (clock.trim_end(), 0)
    } else if let Some(at) = text.rfind(['+', '-']) {
        let (clock, zone) = text.split_at_checked(at)?;
        let sign = if zone.starts_with('-') { -1 } else { 1 };
        let digits: String = zone.chars().skip(1).filter(|c| *c != ':').collect();
        let value: i128 = digits.parse().ok()?;
        (clock, sign * if digits.len() <= 2 { value * 60 } else { value / 100 * 60 + value % 100 })
    } else {
        (text, 0)
    };
    let mut parts = clock.trim_end().split(':');
    let mut whole =
        |most: i128| parts.next()?.parse::<i128>().ok().filter(|x| (0..=most).contains(x));
    let (hours, minutes) = (whole(24)?, whole(59)?);
    let seconds_ns = match parts.next() {
        None => 0,
        Some(text) => {
            let (seconds, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
            if fraction.len() > 18 || !fraction.bytes().all(|b| b.is_ascii_digit()) {
                return None;
            }
            let nine: String = fraction.chars().chain(std::iter::repeat('0')).take(9).collect();
            // A leap second is 60.
            seconds.parse::<i128>().ok().filter(|s| (0..=60).contains(s))? * 1_000_000_000
                + nine.parse::<i128>().ok()?
        }
    };
    if parts.next().is_some() {
        return None;
    }
    Some((hours * 3600 + minutes * 60 - zone_min * 60) * 1_000_000_000 + seconds_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_nanoseconds_since_1970() {
        // Witness: `date -u -d TEXT +%s%N` of GNU coreutils.
        for (text, ns) in [
            ("1970-01-01", 0),
            ("2024-02-29T12:30:01.25Z", 1_709_209_801_250_000_000),
            ("2000-03-01 00:00:00", 951_868_800_000_000_000),
            ("2024-03-01T13:30:01,25+01:00", 1_709_296_201_250_000_000),
            ("1969-12-31T23:59:59.999999999Z", -1),
            ("2024-03-01T07:30-0500", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30:00 UTC", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30 GMT", 1_709_296_200_000_000_000),
            ("20240301T123000Z", 1_709_296_200_000_000_000),
            ("20240301T1330+0100", 1_709_296_200_000_000_000),
            ("01.03.2024 12:30", 1_709_296_200_000_000_000),
            ("1.3.2024 12:30:00 PM", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30 AM", 1_709_253_000_000_000_000),
            ("2024-02-29 24:00:00", 1_709_251_200_000_000_000),
            ("01.03.24 12:30:00", 1_709_296_200_000_000_000),
            ("1.3.24, 12:30:00,0 Uhr", 1_709_296_200_000_000_000),
            ("01.03.2024 12:30 Uhr", 1_709_296_200_000_000_000),
            ("20240301123000", 1_709_296_200_000_000_000),
            ("01-Mar-2024 12:30:00", 1_709_296_200_000_000_000),
            ("1. März 2024 12:30", 1_709_296_200_000_000_000),
            ("March 1, 2024 12:30 PM", 1_709_296_200_000_000_000),
            ("1 Mar 2024", 1_709_251_200_000_000_000),
        ] {
            assert_eq!(date(text), Some(ns), "{text}");
        }
        for text in [
            "",
            "2024",
            "12:30:01",
            "2024-13-01",
            "2024-03-01T25:00",
            "2024-03-01T10:00:00.x",
            "20240301",
            "a-b-c",
            "2024-03-01T1é:00",
            "20241301123000",
            "30240301123000",
            "01-Foo-2024 12:30:00",
            "Mar 2024",
            "Mar é 2024",
            "1.3.4",
        ] {
            assert_eq!(date(text), None, "{text}");
        }
    }
}
