//! What the report keeps between runs, outside the repository: references, which are made once and are the same for everybody, and what
//! was measured of a section that was interrupted.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use flate2::Crc;
use serde::{Serialize, de::DeserializeOwned};

use super::desk::cpu_name;

/// Environment variable with another folder; without it a folder of the user's cache.
const FOLDER_VARIABLE: &str = "CLERESTORY_REPORT_CACHE";
/// Between the key of numbers and the seconds that it took to make them.
const NOTED: &str = "\nseconds: ";

/// What is made once, and the seconds that this took.
#[derive(Debug, PartialEq)]
pub struct Numbers {
    /// What was made.
    pub values: Vec<f32>,
    /// Of all runs that made it; unknown where one of them did not note them.
    pub secs: Option<f64>,
    /// The same of earlier runs alone: none where all of it was made now.
    pub earlier_secs: Option<f64>,
}

/// A folder outside the repository.
pub struct Kept {
    folder: PathBuf,
}

impl Kept {
    /// The folder of the user who runs the report.
    ///
    /// # Errors
    /// If the system has no place for one.
    pub fn of_user() -> Result<Kept> {
        let named = std::env::var_os(FOLDER_VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from);
        let folder = named.or_else(|| Some(dirs::cache_dir()?.join("clerestory").join("report")));
        let folder = folder.with_context(|| format!("no cache folder; name one in {FOLDER_VARIABLE}"))?;
        Ok(Kept { folder })
    }

    /// Another folder, which need not be there.
    #[cfg(test)]
    pub fn within(folder: PathBuf) -> Kept {
        Kept { folder }
    }

    /// Numbers that a key names in full; made if they are not there, or are not what was written.
    ///
    /// # Errors
    /// If they cannot be made or written.
    pub fn numbers(&self, key: &str, make: impl FnOnce() -> Result<Vec<f32>>) -> Result<Numbers> {
        self.read_or_made(key, || {
            let begun = Instant::now();
            let values = make()?;
            Ok(Numbers { values, secs: Some(begun.elapsed().as_secs_f64()), earlier_secs: Some(0.0) })
        })
    }

    fn read_or_made(&self, key: &str, make: impl FnOnce() -> Result<Numbers>) -> Result<Numbers> {
        let path = self.numbers_of(key);
        if let Some(numbers) = read(&path, key) {
            return Ok(numbers);
        }
        let numbers = make()?;
        let bytes: Vec<u8> = numbers.values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let head = numbers.secs.map_or(key.to_string(), |secs| format!("{key}{NOTED}{secs}"));
        let mut file = Vec::with_capacity(bytes.len() + head.len() + 8);
        file.extend((head.len() as u32).to_le_bytes());
        file.extend(head.as_bytes());
        file.extend(crc(&bytes).to_le_bytes());
        file.extend(bytes);
        put(&path, &file)?;
        Ok(numbers)
    }

    /// The same, made piece by piece: each is written down as soon as it is made, so that long work goes on where it was interrupted,
    /// until all of them are joined.
    ///
    /// # Errors
    /// If they cannot be made, written or, once they are joined, removed.
    pub fn in_pieces(
        &self,
        key: &str,
        n_pieces: usize,
        make: impl Fn(usize) -> Result<Vec<f32>>,
        join: impl FnOnce(&[Vec<f32>]) -> Vec<f32>,
    ) -> Result<Numbers> {
        if n_pieces == 1 {
            return self.numbers(key, || Ok(join(&[make(0)?])));
        }
        let key_of = |nth: usize| format!("{key}, piece {nth} of {n_pieces}");
        let mut are_new = false;
        let numbers = self.read_or_made(key, || {
            are_new = true;
            let piece = |nth: usize| self.numbers(&key_of(nth), || make(nth));
            let pieces = (0..n_pieces).map(piece).collect::<Result<Vec<Numbers>>>()?;
            let secs = pieces.iter().map(|piece| piece.secs).sum::<Option<f64>>();
            let earlier_secs = pieces.iter().map(|piece| piece.earlier_secs).sum::<Option<f64>>();
            let values = join(&pieces.into_iter().map(|piece| piece.values).collect::<Vec<_>>());
            Ok(Numbers { values, secs, earlier_secs })
        })?;
        for path in (0..n_pieces).filter(|_| are_new).map(|nth| self.numbers_of(&key_of(nth))) {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        Ok(numbers)
    }

    fn numbers_of(&self, key: &str) -> PathBuf {
        self.folder.join("references").join(format!("{:08x}-{:08x}.bin", crc(key.as_bytes()), key.len()))
    }

    /// What was measured of a part of a section, by this very program on this machine: as it is written down from an interrupted run,
    /// with the seconds that it took then, else measured now.
    ///
    /// # Errors
    /// If it cannot be measured or written.
    pub fn part<T: Serialize + DeserializeOwned>(
        &self,
        section: &str,
        part: &str,
        measure: impl FnOnce() -> Result<T>,
    ) -> Result<(T, Option<f64>)> {
        let path = self.parts(section)?.join(format!("{part}.json"));
        if let Some((secs, value)) = fs::read(&path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()) {
            return Ok((value, Some(secs)));
        }
        let begun = Instant::now();
        let value = measure()?;
        put(&path, &serde_json::to_vec(&(begun.elapsed().as_secs_f64(), &value))?)?;
        Ok((value, None))
    }

    /// Forgets the parts of a section that is finished: the next run measures again.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn finish(&self, section: &str) -> Result<()> {
        let folder = self.parts(section)?;
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
        }
        Ok(())
    }

    /// Parts of another program, or of another machine that has the same folder, are none of this one: they lie apart.
    fn parts(&self, section: &str) -> Result<PathBuf> {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        self.parts_on(&format!("{threads} threads of {}", cpu_name()), section)
    }

    fn parts_on(&self, machine: &str, section: &str) -> Result<PathBuf> {
        let program = fs::read(std::env::current_exe()?).context("cannot read this program")?;
        Ok(self.folder.join("parts").join(format!("{section}-{:08x}-{:08x}", crc(&program), crc(machine.as_bytes()))))
    }
}

/// Checksum and length in words: what tells the contents of a file from others of its name.
pub fn checksum(bytes: &[u8]) -> String {
    format!("{:08x} of {} bytes", crc(bytes), bytes.len())
}

/// The values of a file, if it is of that key and as it was written; older files do not tell how long it took to make them.
fn read(path: &Path, key: &str) -> Option<Numbers> {
    let file = fs::read(path).ok()?;
    let (length, rest) = file.split_first_chunk::<4>()?;
    let (head, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let (hash, bytes) = rest.split_first_chunk::<4>()?;
    let head = std::str::from_utf8(head).ok()?;
    let (own_key, secs) = head.split_once(NOTED).map_or((head, None), |(own_key, secs)| (own_key, secs.parse().ok()));
    let is_whole = own_key == key && u32::from_le_bytes(*hash) == crc(bytes);
    let values = || bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
    is_whole.then(|| Numbers { values: values(), secs, earlier_secs: secs })
}

/// Writes a file so that it is there whole or not at all.
fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().context("a file lies in a folder")?;
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    clerestory::output::write_whole(path, bytes)
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(name: &str) -> Kept {
        Kept::within(std::env::temp_dir().join(format!("clerestory-kept-{name}-{}", std::process::id())))
    }

    #[test]
    fn numbers_are_made_once_and_again_where_they_were_damaged() {
        let kept = kept("numbers");
        let made = || kept.numbers("a scene", || Ok(vec![1.0, 2.5]));
        assert_eq!(made().unwrap().values, [1.0, 2.5]);
        assert_eq!(kept.numbers("a scene", || panic!("it is there")).unwrap().values, [1.0, 2.5]);
        let path = fs::read_dir(kept.folder.join("references")).unwrap().next().unwrap().unwrap().path();
        let mut bytes = fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(&path, bytes).unwrap();
        assert_eq!(kept.numbers("a scene", || Ok(vec![3.0])).unwrap().values, [3.0]);
        fs::remove_dir_all(&kept.folder).unwrap();
    }

    #[test]
    fn numbers_tell_the_seconds_of_the_run_that_made_them_unless_they_are_too_old_for_it() {
        let kept = kept("seconds");
        let slow = || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            Ok(vec![1.0])
        };
        let made = kept.numbers("a scene", slow).unwrap();
        assert!(made.secs.is_some_and(|secs| secs >= 0.02) && made.earlier_secs == Some(0.0), "{made:?}");
        let again = kept.numbers("a scene", || panic!("it is there")).unwrap();
        assert_eq!(again, Numbers { values: vec![1.0], secs: made.secs, earlier_secs: made.secs });
        // As files were before seconds were noted: the key alone, and the values behind their checksum.
        let value = 2.0f32.to_le_bytes();
        let old: [&[u8]; 4] = [&4u32.to_le_bytes(), b"hall", &crc(&value).to_le_bytes(), &value];
        fs::write(kept.numbers_of("hall"), old.concat()).unwrap();
        let old = kept.numbers("hall", || panic!("it is there")).unwrap();
        assert_eq!(old, Numbers { values: vec![2.0], secs: None, earlier_secs: None });
        fs::remove_dir_all(&kept.folder).unwrap();
    }

    #[test]
    fn numbers_in_pieces_go_on_behind_the_last_one_that_was_written() {
        let kept = kept("pieces");
        let one = |nth: usize| {
            std::thread::sleep(std::time::Duration::from_millis(1));
            vec![nth as f32]
        };
        let join = |pieces: &[Vec<f32>]| pieces.concat();
        let interrupted = kept.in_pieces(
            "a scene",
            3,
            |nth| {
                anyhow::ensure!(nth < 2, "interrupted");
                Ok(one(nth))
            },
            join,
        );
        assert!(interrupted.is_err());
        let made = std::cell::RefCell::new(Vec::new());
        let values = kept.in_pieces(
            "a scene",
            3,
            |nth| {
                made.borrow_mut().push(nth);
                Ok(one(nth))
            },
            join,
        );
        let numbers = values.unwrap();
        assert_eq!((&numbers.values, made.into_inner()), (&vec![0.0, 1.0, 2.0], vec![2]));
        assert!(numbers.earlier_secs > Some(0.0) && numbers.secs > numbers.earlier_secs, "{numbers:?}");
        assert_eq!(fs::read_dir(kept.folder.join("references")).unwrap().count(), 1, "the pieces are gone");
        let whole = kept.numbers("a scene", || panic!("it is whole")).unwrap();
        assert_eq!((whole.values, whole.secs), (vec![0.0, 1.0, 2.0], numbers.secs));
        fs::remove_dir_all(&kept.folder).unwrap();
    }

    #[test]
    fn numbers_of_another_key_are_not_taken_even_where_its_own_would_lie() {
        let kept = kept("keys");
        kept.numbers("a scene, version 0.1.0", || Ok(vec![1.0])).unwrap();
        let (old, new) = (kept.numbers_of("a scene, version 0.1.0"), kept.numbers_of("a scene, tracer 1"));
        assert_ne!(old, new);
        fs::rename(old, new).unwrap();
        assert_eq!(kept.numbers("a scene, tracer 1", || Ok(vec![2.0])).unwrap().values, [2.0]);
        fs::remove_dir_all(&kept.folder).unwrap();
    }

    #[test]
    fn a_checksum_knows_contents_of_one_length_apart() {
        assert_eq!(checksum(b"123456789"), "cbf43926 of 9 bytes");
        assert_ne!(checksum(b"a room"), checksum(b"a hall"));
    }

    #[test]
    fn parts_of_another_machine_lie_apart() {
        let kept = kept("machines");
        let [two, four] = ["2 threads of a CPU", "4 threads of a CPU"].map(|on| kept.parts_on(on, "time").unwrap());
        assert_ne!(two, four);
        assert_eq!(kept.parts("time").unwrap(), kept.parts("time").unwrap());
    }

    #[test]
    fn a_part_is_measured_once_until_its_section_is_finished() {
        let kept = kept("parts");
        let slow = || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            Ok(7)
        };
        assert_eq!(kept.part("time", "gallery", slow).unwrap(), (7, None));
        let (value, secs) = kept.part("time", "gallery", || Ok(8)).unwrap();
        assert!(value == 7 && secs.is_some_and(|secs| secs >= 0.02), "{value} after {secs:?} s");
        kept.finish("time").unwrap();
        assert_eq!(kept.part("time", "gallery", || Ok(8)).unwrap(), (8, None));
        fs::remove_dir_all(&kept.folder).unwrap();
    }
}
