//! Units that are taken for one another, with their factors.

/// A unit that a log may have in place of the model's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Factor {
    /// How the other unit is written.
    pub(super) unit: &'static str,
    /// A number in the other unit over the same in the model's.
    pub(super) factor: f64,
}

const DEGREES: f64 = 180.0 / std::f64::consts::PI;
const TURN: f64 = std::f64::consts::TAU;
/// Standard gravity, m/s² (exact by definition, CGPM 1901).
const GRAVITY: f64 = 9.80665;

/// Families of one quantity: every unit with the size of its unit in the family's first.
const FAMILIES: [&[(&str, f64)]; 14] = [
    &[("rad", 1.0), ("deg", 1.0 / DEGREES), ("mrad", 1e-3), ("rev", TURN)],
    &[
        ("rad/s", 1.0),
        ("deg/s", 1.0 / DEGREES),
        ("rpm", TURN / 60.0),
        ("rev/s", TURN),
        ("mrad/s", 1e-3),
    ],
    &[("rad/s^2", 1.0), ("deg/s^2", 1.0 / DEGREES)],
    &[("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("km", 1e3), ("ft", 0.3048), ("in", 0.0254)],
    &[
        ("m/s", 1.0),
        ("km/h", 1.0 / 3.6),
        ("mm/s", 1e-3),
        ("cm/s", 1e-2),
        ("ft/s", 0.3048),
        ("kn", 1852.0 / 3600.0),
        ("mph", 0.44704),
    ],
    &[("m/s^2", 1.0), ("g", GRAVITY), ("mm/s^2", 1e-3), ("ft/s^2", 0.3048)],
    &[("N", 1.0), ("kN", 1e3), ("mN", 1e-3), ("kgf", GRAVITY), ("lbf", 4.448_221_615)],
    &[("N m", 1.0), ("mN m", 1e-3), ("kgf m", GRAVITY), ("N mm", 1e-3)],
    &[("V", 1.0), ("mV", 1e-3)],
    &[("A", 1.0), ("mA", 1e-3)],
    &[("Pa", 1.0), ("kPa", 1e3), ("bar", 1e5), ("hPa", 1e2)],
    &[("W", 1.0), ("kW", 1e3), ("mW", 1e-3)],
    &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6)],
    &[("1", 1.0), ("%", 1e-2)],
];
/// Ways of writing the same unit.
const SPELLINGS: [(&str, &str); 9] = [
    ("°", "deg"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("°/s", "deg/s"),
    ("dps", "deg/s"),
    ("1/min", "rpm"),
    ("rev/min", "rpm"),
    ("Nm", "N m"),
    ("knots", "kn"),
];
/// Where the model gives no unit: the factors that are so common that they may be guessed.
const COMMON: [Factor; 5] = [
    Factor { unit: "degrees instead of radians", factor: DEGREES },
    Factor { unit: "radians instead of degrees", factor: 1.0 / DEGREES },
    Factor { unit: "a thousandth of the unit", factor: 1e3 },
    Factor { unit: "a thousand times the unit", factor: 1e-3 },
    Factor { unit: "per cent instead of parts", factor: 100.0 },
];

/// A unit as the families write it.
fn plain(unit: &str) -> String {
    let spelt = unit.replace('²', "^2").replace(['·', '*'], " ").replace("s2", "s^2");
    let spelt = spelt.split_whitespace().collect::<Vec<_>>().join(" ");
    SPELLINGS.iter().find(|(from, _)| *from == spelt).map_or(spelt, |(_, to)| (*to).to_owned())
}

/// The possible units of the samples where the model has `unit`.
pub(super) fn alternatives(unit: Option<&str>) -> Vec<Factor> {
    let Some(unit) = unit.map(plain) else { return COMMON.to_vec() };
    let family = FAMILIES
        .iter()
        .find_map(|family| Some((family, family.iter().find(|(name, _)| *name == unit)?.1)));
    let Some((family, own)) = family else { return Vec::new() };
    family
        .iter()
        .filter(|(name, _)| *name != unit)
        .map(|&(unit, size)| Factor { unit, factor: own / size })
        .collect()
}

/// The factor between two stated units: a number in `logged` over the same in `modelled`.
pub(super) fn between(logged: &str, modelled: &str) -> Option<f64> {
    let logged = plain(logged);
    alternatives(Some(modelled)).into_iter().find(|f| f.unit == logged).map(|f| f.factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_those_of_the_units() {
        let of = |logged, modelled| between(logged, modelled).unwrap();
        // 180/π, 60/2π, 3.6, 1/9.80665.
        for (logged, modelled, factor) in [
            ("deg", "rad", 57.295_779_513),
            ("°/s", "rad/s", 57.295_779_513),
            ("rpm", "rad/s", 9.549_296_586),
            ("km/h", "m/s", 3.6),
            ("g", "m/s²", 0.101_971_621),
            ("mm", "m", 1000.0),
            ("%", "1", 100.0),
            ("rad", "deg", 0.017_453_292_520),
        ] {
            assert!((of(logged, modelled) / factor - 1.0).abs() < 1e-8, "{logged} for {modelled}");
        }
        assert_eq!(between("V", "rad"), None);
        assert!(alternatives(Some("furlong")).is_empty());
    }
}
