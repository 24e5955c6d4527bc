//! d
use deadtime::delay::*;
use deadtime::identify::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut log = deadtime::log::read(std::path::Path::new(&a[1])).unwrap();
    if a.len() > 4 {
        log = log.resample(deadtime::time::SampleTime::new(a[4].parse().unwrap()).unwrap(), &[&a[2]]).unwrap();
    }
    let e = Experiment::from_logs(&[log], &[a[2].clone()], &[a[3].clone()], Detrend::Mean).unwrap();
    let r = e.from_rest();
    println!("rest {}", r.is_some());
    let e = r.unwrap_or(e);
    let recs = e.pair(0, 0).unwrap();
    for initial in [Initial::Zero, Initial::Estimated] {
        let fits = OutputError { nb: 1, nf: 2, initial }.scan(&recs, 35);
        let p = recs[0].y.iter().map(|v| v * v).sum::<f64>() / recs[0].y.len() as f64;
        for (nk, f) in fits.iter().enumerate() {
            if let Some(f) = f {
                if nk % 2 == 0 || nk < 6 {
                    println!("{nk} {:.6e} {:?} {:?} {:?}", f.loss / p, f.b, f.f, f.stopped);
                }
            }
        }
    }
}
