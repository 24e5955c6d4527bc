//! Names and units of columns of time.

use crate::options::TimeUnit;

/// The possible names of a column of time, lower case, without the unit.
const NAMES: [&str; 34] = [
    "time",
    "__time",
    "_time",
    "timestamp",
    "time_stamp",
    "stamp",
    "datetime",
    "date_time",
    "date",
    "date/time",
    "elapsed",
    "elapsed_time",
    "header.stamp",
    "log_time",
    "rosbagtimestamp",
    "epoch",
    "unix_time",
    "utc",
    "ts",
    "x_value",
    "tow",
    "gps_time",
    "zeit",
    "zeitstempel",
    "uhrzeit",
    "datum",
    "datum/zeit",
    "datum/uhrzeit",
    "datum_zeit",
    "datum_uhrzeit",
    "datum_und_zeit",
    "datum_und_uhrzeit",
    "last_changed",
    "last_updated",
];
/// Words in brackets behind a name of time that are no unit.
const ZONES: [&str; 6] = ["utc", "gmt", "local", "gps", "cet", "iso"];
const UNITS: [(TimeUnit, &[&str]); 7] = [
    (TimeUnit::S, &["s", "sec", "secs", "second", "seconds", "sek", "sekunden"]),
    (TimeUnit::Ms, &["ms", "msec", "msecs", "millis", "millisecond", "milliseconds"]),
    (TimeUnit::Us, &["us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"]),
    (TimeUnit::Ns, &["ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"]),
    (TimeUnit::Min, &["min", "mins", "minute", "minutes", "minuten"]),
    (TimeUnit::H, &["h", "hr", "hrs", "hour", "hours", "std", "stunden"]),
    (TimeUnit::D, &["d", "day", "days", "tage"]),
];

/// The unit that a header writes.
pub(super) fn unit(text: &str) -> Option<TimeUnit> {
    let text = text.trim().trim_end_matches('.').to_lowercase();
    UNITS.iter().find(|(_, names)| names.contains(&text.as_str())).map(|(unit, _)| *unit)
}

/// Whether a column of this name, without its unit in brackets, may be the time, and the unit in the name. `t` may be a temperature except in the first column.
pub(super) fn named(name: &str, first: bool) -> Option<Option<TimeUnit>> {
    let name = name.trim().to_lowercase();
    if known(&name, first) {
        return Some(None);
    }
    // As autopilots write it.
    if let Some(unit @ (TimeUnit::Ms | TimeUnit::Us | TimeUnit::Ns)) =
        name.strip_prefix("time").and_then(unit)
    {
        return Some(Some(unit));
    }
    // `h` and `d` may be a height and a distance, `min` the least.
    if first && let Some(unit) = unit(&name).filter(|unit| !long(*unit) || name.len() > 3) {
        return Some(Some(unit));
    }
    let open = name.strip_suffix(')').unwrap_or(&name);
    let (base, suffix) = open.rsplit_once(['_', '(', '/', ' '])?;
    let base = base.trim_end_matches(['_', ' ']);
    if name.ends_with(')') && known(base, first) && ZONES.contains(&suffix.trim()) {
        return Some(None);
    }
    let bare = base == "t" && !name.ends_with(')');
    known(base, first).then(|| unit(suffix)).flatten().filter(|u| !(bare && long(*u))).map(Some)
}

/// Whether a name is one of time; `t` may be a temperature anywhere but in front.
fn known(name: &str, first: bool) -> bool {
    let name = name.replace(' ', "_");
    NAMES.contains(&name.as_str()) || (first && name == "t")
}

fn long(unit: TimeUnit) -> bool {
    matches!(unit, TimeUnit::Min | TimeUnit::H | TimeUnit::D)
}

/// The text in brackets of a name of time where it is no known unit.
pub(super) fn unknown_unit(name: &str, first: bool) -> Option<String> {
    let lower = name.trim().to_lowercase();
    let (base, suffix) = lower.strip_suffix(')')?.rsplit_once('(')?;
    let strange = named(name, first).is_none() && known(base.trim_end(), first);
    strange.then(|| suffix.trim().to_owned())
}

/// As [`named`], of arrays, which have no order.
pub(crate) fn named_time(name: &str) -> Option<Option<TimeUnit>> {
    named(name, false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_time_tell_their_unit() {
        for (name, unit) in [
            ("timestamp", None),
            ("time_us", Some(TimeUnit::Us)),
            ("Time (ms)", Some(TimeUnit::Ms)),
            ("stamp_ns", Some(TimeUnit::Ns)),
            ("t_s", Some(TimeUnit::S)),
            ("millis", Some(TimeUnit::Ms)),
            ("Time (min)", Some(TimeUnit::Min)),
            ("tow(msec)", Some(TimeUnit::Ms)),
            ("elapsed time (h)", Some(TimeUnit::H)),
            ("days", Some(TimeUnit::D)),
            ("Zeit", None),
            ("Datum (UTC)", None),
            ("ts", None),
            ("Datum/Zeit", None),
            ("Datum Uhrzeit", None),
            ("Zeit (Std.)", Some(TimeUnit::H)),
            ("Zeit (Minuten)", Some(TimeUnit::Min)),
            ("_time", None),
        ] {
            assert_eq!(named(name, true), Some(unit), "{name}");
        }
        for name in ["speed", "t", "millis", "u_s", "lifetime", "temp_s", ""] {
            assert_eq!(named(name, false), None, "{name}");
        }
        for name in ["h", "d", "min", "t_min", "Time (fortnights)"] {
            assert_eq!(named(name, true), None, "{name}");
        }
        assert_eq!(unknown_unit("Time (Fortnights)", false).as_deref(), Some("fortnights"));
        for name in ["Time (min)", "time", "height (ft)", "t_min"] {
            assert_eq!(unknown_unit(name, true), None, "{name}");
        }
    }
}
