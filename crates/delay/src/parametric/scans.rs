//! Output-error scans shared by several methods.

use std::hash::{DefaultHasher, Hasher};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use deadtime_identify::{Initial, OeFit, OutputError, Record};
use deadtime_signal::stop::Stop;

/// The model of every delay.
type Fits = Vec<Option<OeFit>>;

/// Scans of one search: methods with the same models and records share one scan. Clones share it too.
#[derive(Debug, Clone, Default)]
pub struct Scans(Arc<Mutex<Vec<Kept>>>);

/// The cache is no option: searches with and without it are equal.
impl PartialEq for Scans {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Number of cached scans.
const KEPT: usize = 4;

#[derive(Debug, Clone)]
struct Kept {
    key: Key,
    fits: Arc<OnceLock<Fits>>,
}

/// The data and models of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    nb: usize,
    nf: usize,
    initial: Initial,
    max_delay: usize,
    /// Hashes of all samples and of the mask.
    data: [u64; 2],
}

impl Key {
    fn of(orders: &OutputError, records: &[Record<'_>], max_delay: usize) -> Self {
        let &OutputError { nb, nf, initial } = orders;
        let (mut hasher, mut samples) = (DefaultHasher::new(), 0);
        for r in records {
            samples += r.len() as u64;
            hasher.write_usize(r.len());
            r.u.iter().take(r.len()).chain(r.y.iter()).for_each(|v| hasher.write_u64(v.to_bits()));
            r.present.iter().flat_map(|p| p.iter()).for_each(|p| hasher.write_u8(u8::from(*p)));
        }
        Self { nb, nf, initial, max_delay, data: [hasher.finish(), samples] }
    }
}

impl Scans {
    /// [`OutputError::scan_until`], computed at the first request; concurrent requests wait for it.
    pub(super) fn fits(
        &self,
        orders: &OutputError,
        records: &[Record<'_>],
        max_delay: usize,
        stop: &Stop,
    ) -> Fits {
        let key = Key::of(orders, records, max_delay);
        let shared = {
            let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let known = kept.iter().find(|k| k.key == key).map(|k| Arc::clone(&k.fits));
            known.unwrap_or_else(|| {
                let fits = Arc::default();
                if kept.len() >= KEPT {
                    kept.remove(0);
                }
                kept.push(Kept { key, fits: Arc::clone(&fits) });
                fits
            })
        };
        let fits = shared.get_or_init(|| orders.scan_until(records, max_delay, stop)).clone();
        if stop.is_set() {
            // A cancelled scan is dropped.
            let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            kept.retain(|k| k.key != key);
        }
        fits
    }

    #[cfg(test)]
    fn made(&self) -> usize {
        self.0.lock().unwrap().len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(scale: f64) -> [Record<'static>; 1] {
        let u: Vec<f64> = (0..60).map(|k| f64::from((k * 7919) % 23) - 11.0).collect();
        let y = (0..60).map(|t| if t < 3 { 0.0 } else { scale * u[t - 3] }).collect::<Vec<_>>();
        [Record::new(u, y)]
    }

    #[test]
    fn the_same_scan_is_made_once_and_another_one_anew() {
        let orders = OutputError { nb: 1, nf: 1, initial: Initial::Zero };
        let (scans, stop) = (Scans::default(), Stop::default());
        let first = scans.fits(&orders, &record(1.0), 8, &stop);
        assert_eq!(first, orders.scan(&record(1.0), 8));
        let clone = scans.clone();
        assert_eq!(clone.fits(&orders, &record(1.0), 8, &stop), first);
        assert_eq!(scans.made(), 1);
        for (made, scale, window) in [(2, 2.0, 8), (3, 1.0, 9)] {
            let fits = scans.fits(&orders, &record(scale), window, &stop);
            assert_eq!(fits, orders.scan(&record(scale), window));
            assert_eq!(scans.made(), made);
        }
        for k in 0..2 * KEPT {
            let _ = scans.fits(&orders, &record(3.0 + k as f64), 8, &stop);
        }
        assert_eq!(scans.made(), KEPT);
    }
}
