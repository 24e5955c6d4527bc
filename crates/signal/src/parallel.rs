//! Items in parallel, their results in order.
//!
//! The threads are those of `rayon`'s pool. The part that divides the work is compiled once, here: a caller adds its closure alone.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Calls `of` with each number below `count`.
fn each(count: usize, of: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(of);
}

/// Takes the value of a slot. No lock is held while a closure of the caller runs, so that none is poisoned.
fn taken<T>(slot: &Mutex<Option<T>>) -> Option<T> {
    slot.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// The results, in the order of the items. Once `ends` holds for one, the items that have not begun are left out.
fn until<I, R>(items: I, of: impl Fn(I::Item) -> R + Sync, ends: fn(&R) -> bool) -> Vec<R>
where
    I: IntoIterator,
    I::Item: Send,
    R: Send,
{
    let slots: Vec<_> =
        items.into_iter().map(|item| (Mutex::new(Some(item)), Mutex::new(None))).collect();
    let ended = AtomicBool::new(false);
    each(slots.len(), &|at| {
        if ended.load(Ordering::Relaxed) {
            return;
        }
        let (item, result) = &slots[at];
        let made = taken(item).map(&of);
        if made.as_ref().is_some_and(ends) {
            ended.store(true, Ordering::Relaxed);
        }
        *result.lock().unwrap_or_else(PoisonError::into_inner) = made;
    });
    slots.iter().filter_map(|(_, result)| taken(result)).collect()
}

/// The result of each item, in the order of the items. A panic of `of` reaches the caller.
pub fn map<I, R>(items: I, of: impl Fn(I::Item) -> R + Sync) -> Vec<R>
where
    I: IntoIterator,
    I::Item: Send,
    R: Send,
{
    until(items, of, |_| false)
}

/// As [`map`], without the items that have no result.
pub fn filter_map<I, R>(items: I, of: impl Fn(I::Item) -> Option<R> + Sync) -> Vec<R>
where
    I: IntoIterator,
    I::Item: Send,
    R: Send,
{
    map(items, of).into_iter().flatten().collect()
}

/// What may fail: [`Option`] and [`Result`].
pub trait Fallible: Send + Sized {
    /// All values, or the first failure.
    type All;
    /// Whether it failed.
    fn failed(&self) -> bool;
    /// All values in order, or the first failure.
    fn all(of: Vec<Self>) -> Self::All;
}
impl<T: Send> Fallible for Option<T> {
    type All = Option<Vec<T>>;
    fn failed(&self) -> bool {
        self.is_none()
    }
    fn all(of: Vec<Self>) -> Self::All {
        of.into_iter().collect()
    }
}
impl<T: Send, E: Send> Fallible for Result<T, E> {
    type All = Result<Vec<T>, E>;
    fn failed(&self) -> bool {
        self.is_err()
    }
    fn all(of: Vec<Self>) -> Self::All {
        of.into_iter().collect()
    }
}

/// The results of all items in their order, or the first failure. After a failure no other item begins.
pub fn try_map<I, R>(items: I, of: impl Fn(I::Item) -> R + Sync) -> R::All
where
    I: IntoIterator,
    I::Item: Send,
    R: Fallible,
{
    R::all(until(items, of, R::failed))
}

/// Calls `of` with each item.
pub fn for_each<I>(items: I, of: impl Fn(I::Item) + Sync)
where
    I: IntoIterator,
    I::Item: Send,
{
    map(items, of);
}

/// Whether `is` holds for one of the items. Once one is found, no other begins.
pub fn any<I>(items: I, is: impl Fn(I::Item) -> bool + Sync) -> bool
where
    I: IntoIterator,
    I::Item: Send,
{
    until(items, is, |found| *found).contains(&true)
}

/// The number of threads.
#[must_use]
pub fn threads() -> usize {
    rayon::current_num_threads()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_items() {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                for count in [0, 1, 2, 1000] {
                    let twice: Vec<usize> = (0..count).map(|i| 2 * i).collect();
                    assert_eq!(map(0..count, |i| 2 * i), twice);
                    let odd: Vec<usize> = (0..count).filter(|i| i % 2 == 1).collect();
                    assert_eq!(filter_map(0..count, |i| (i % 2 == 1).then_some(i)), odd);
                    assert_eq!(any(0..count, |i| i == 999), count == 1000);
                }
            });
        }
    }

    #[test]
    fn one_failure_fails_all_and_the_rest_does_not_begin() {
        let all = try_map(0..9, Some);
        assert_eq!(all, Some((0..9).collect()));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let begun = Mutex::new(Vec::new());
        let of = |i: usize| {
            begun.lock().unwrap().push(i);
            if i == 3 { Err("the fourth") } else { Ok(i) }
        };
        let failed = pool.install(|| try_map(0..9, of));
        assert_eq!(failed, Err("the fourth"));
        assert_eq!(begun.lock().unwrap().len(), 4);
    }

    #[test]
    fn items_are_changed_in_place_and_moved_in() {
        let mut words: Vec<String> = ["a", "b"].map(str::to_owned).into();
        for_each(&mut words, |word| word.push('!'));
        assert_eq!(map(words, |word| word + "?"), ["a!?", "b!?"]);
    }

    #[test]
    fn calls_within_calls_end() {
        let sums = map(0..20, |i| map(0..20, |j| i * j).into_iter().sum::<usize>());
        assert_eq!(sums, (0..20).map(|i| 190 * i).collect::<Vec<usize>>());
    }

    #[test]
    #[should_panic(expected = "the seventh")]
    fn a_panic_reaches_the_caller() {
        map(0..20, |i| assert!(i != 7, "the seventh"));
    }
}
