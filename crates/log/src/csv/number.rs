//! Plain decimals, fast: what nearly every cell of a log is.
//!
//! A whole number below 2⁵³ and a power of ten up to 10²² are both exact. Their quotient is rounded once, and therefore correctly. Source: Clinger
//! (1990), "How to read floating point numbers accurately", PLDI, section 5, doi:10.1145/93542.93557.

const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];
/// The number of digits of which every number is below 2⁵³.
const DIGITS: usize = 15;

/// The number of a cell such as `-12.345`, to the bit that the standard library reads. `None` where the cell has any other form, which may still be a number.
pub(super) fn decimal(cell: &[u8]) -> Option<f64> {
    let (negative, digits) = match cell.split_first()? {
        (b'-', rest) => (true, rest),
        _ => (false, cell),
    };
    // One more for a decimal point.
    if digits.len() > DIGITS + 1 {
        return None;
    }
    let (mut whole, mut behind, mut seen) = (0_u64, None, 0_usize);
    for &byte in digits {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 {
            whole = 10 * whole + u64::from(digit);
            seen += 1;
            behind = behind.map(|n: usize| n + 1);
        } else if byte == b'.' && behind.is_none() {
            behind = Some(0);
        } else {
            return None;
        }
    }
    if seen == 0 || seen > DIGITS {
        return None;
    }
    let x = whole as f64 / TENS.get(behind.unwrap_or(0))?;
    Some(if negative { -x } else { x })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Witness: the standard library's parser.
    #[test]
    fn every_decimal_is_what_the_standard_library_reads() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut read = 0;
        for _ in 0..200_000 {
            let length = rng.random_range(1..20);
            let text: String = (0..length)
                .map(|_| char::from(b"0123456789.-0123456789"[rng.random_range(0..22)]))
                .collect();
            if let Some(x) = decimal(text.as_bytes()) {
                assert_eq!(text.parse::<f64>().map(f64::to_bits), Ok(x.to_bits()), "{text}");
                read += 1;
            }
        }
        assert!(read > 50_000, "only {read}");
        for text in [
            "0",
            "-0",
            "-0.0",
            "1.",
            ".5",
            "999999999999999",
            "0.00000000000001",
            "123456789.012345",
        ] {
            assert_eq!(
                decimal(text.as_bytes()).map(f64::to_bits),
                text.parse().ok().map(f64::to_bits),
                "{text}"
            );
        }
        for text in [
            "",
            "-",
            ".",
            "-.",
            "+1",
            "1e3",
            "1,5",
            "inf",
            "NaN",
            "1.2.3",
            "--1",
            "1-",
            "1234567890123456",
            "0x1",
        ] {
            assert_eq!(decimal(text.as_bytes()), None, "{text}");
        }
    }
}
