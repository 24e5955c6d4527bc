//! A bag of ROS 2 as its recorder leaves it: a folder of one or more files, and `metadata.yaml`, which names them in order.

use deadtime_signal::remedy::Message;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use super::bag::Bag;
use super::counted::Counted;
use super::error::{Error, LogError};
use super::options::ReadOptions;
use super::recording::Recording;
use super::{mcap, rosbag2};

const NAME: &str = "a bag of ROS 2";
/// The file with the names of the others.
const METADATA: &str = "metadata.yaml";

/// Reads a folder: its files one after the other, as one recording.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    let refused = |what: String| LogError::format(&source, NAME, what);
    let parts = parts(path).map_err(|e| Error::io(path, e))?;
    let length = |part: &PathBuf| std::fs::metadata(part).map_or(0, |there| there.len());
    let mut bag = Bag::new(options, parts.iter().map(length).sum());
    for (at, part) in parts.iter().enumerate() {
        let file = part.display().to_string();
        if at > 0 {
            bag.next_part();
        }
        let share = |of: usize| of as f64 / parts.len() as f64;
        let bytes = Counted::open(part, &options.far.part(share(at), share(at + 1)))
            .map_err(|e| Error::io(part, e))?;
        let before = bag.notes.len();
        match part.extension().and_then(|e| e.to_str()) {
            Some("mcap") => mcap::fill(&file, BufReader::with_capacity(1 << 18, bytes), &mut bag)?,
            Some("db3") => {
                bag.notes.extend(rosbag2::journal(part));
                rosbag2::fill(&file, BufReader::new(bytes), &mut bag)?;
            }
            _ => {
                let what = format!(
                    "`{file}` is packed as a whole, which is not read; unpack it with `zstd -d` and correct {METADATA}"
                );
                return Err(refused(what).into());
            }
        }
        if parts.len() > 1 {
            let name = part.file_name().unwrap_or_default().to_string_lossy();
            bag.notes
                .iter_mut()
                .skip(before)
                .for_each(|note| *note = Message::from(format!("{name}: ")).and(note.clone()));
        }
    }
    if parts.is_empty() {
        return Err(refused(
            "a folder without files that end in .mcap or .db3; give a file".into(),
        )
        .into());
    }
    bag.finish(&source, "rosbag2", NAME)
}

/// Its files in order: that of `metadata.yaml`, else by their names, `bag_10` behind `bag_9`.
fn parts(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let text = std::fs::read_to_string(folder.join(METADATA)).unwrap_or_default();
    let mut named =
        text.lines().map(str::trim).skip_while(|line| *line != "relative_file_paths:").skip(1);
    let named: Vec<PathBuf> = std::iter::from_fn(|| {
        named
            .next()?
            .strip_prefix("- ")
            .map(|name| name.trim().trim_matches(['"', '\'']).to_owned())
    })
    // Since the bag was written it may have been moved: paths within it are names.
    .filter_map(|name| Some(folder.join(Path::new(&name).file_name()?)))
    .collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "mcap" || e == "db3") {
            found.push(path);
        }
    }
    found.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    Ok(found)
}
