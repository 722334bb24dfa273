//! Which files of a folder are pictures, what their lights are called, and in which order they come.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::fs;
use std::path::Path;

use super::{StackError, StackImage, cannot_read};

/// Endings of pictures, lower case.
const ENDINGS: [&str; 5] = ["exr", "hdr", "png", "jpg", "jpeg"];

/// Something in a folder.
pub(super) enum Entry {
    /// By its name a picture.
    Picture(StackImage),
    /// The name of anything else.
    Other(String),
}

/// What lies in a folder, in natural order of the names.
pub(super) fn entries(folder: &Path) -> Result<Vec<Entry>, StackError> {
    if folder.is_file() {
        return Err(StackError::NoFolder { path: folder.into() });
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(cannot_read(folder))? {
        let entry = entry.map_err(cannot_read(folder))?;
        found.push((entry.file_name().to_string_lossy().into_owned(), entry.path()));
    }
    found.sort_by(|(a, _), (b, _)| natural_order(a, b));
    let mut files_of_keys = HashMap::new();
    let mut entries = Vec::new();
    for (name, path) in found {
        // A pipe would be waited for when it is opened. What is not there any more is named when it is read.
        let is_no_file = || fs::metadata(&path).is_ok_and(|there| !there.is_file());
        if !is_picture(&name) || is_no_file() {
            entries.push(Entry::Other(name));
            continue;
        }
        let key = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        if let Some(first) = files_of_keys.insert(key.clone(), path.clone()) {
            return Err(StackError::SameKey { first, second: path, key });
        }
        entries.push(Entry::Picture(StackImage { key, path }));
    }
    Ok(entries)
}

/// By its name; files that begin with a dot are hidden.
fn is_picture(name: &str) -> bool {
    let ending = name.rsplit_once('.').map(|(stem, ending)| (stem, ending.to_lowercase()));
    ending.is_some_and(|(stem, ending)| !stem.is_empty() && ENDINGS.contains(&ending.as_str()))
        && !name.starts_with('.')
}

/// As people count: runs of digits by their value, all else by its letters.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a_rest, mut b_rest) = (a, b);
    while !a_rest.is_empty() && !b_rest.is_empty() {
        let ((a_run, a_number), (b_run, b_number)) = (first_run(a_rest), first_run(b_rest));
        let order = match (a_number, b_number) {
            (Some(a), Some(b)) => a.len().cmp(&b.len()).then_with(|| a.cmp(b)),
            _ => a_run.cmp(b_run),
        };
        if order != Ordering::Equal {
            return order;
        }
        (a_rest, b_rest) = (&a_rest[a_run.len()..], &b_rest[b_run.len()..]);
    }
    // Names that differ in leading zeros alone still have an order.
    a_rest.len().cmp(&b_rest.len()).then_with(|| a.cmp(b))
}

/// The digits, or what is none, at the start of a name; of digits those that count.
fn first_run(name: &str) -> (&str, Option<&str>) {
    let is_number = name.starts_with(|c: char| c.is_ascii_digit());
    let end = name.find(|c: char| c.is_ascii_digit() != is_number).unwrap_or(name.len());
    let run = &name[..end];
    (run, is_number.then(|| run.trim_start_matches('0')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_as_people_count() {
        let sorted = [
            "01.exr",
            "1.exr",
            "2.exr",
            "10.exr",
            "99999999999999999999999998.exr",
            "99999999999999999999999999.exr",
            "a1b2.exr",
            "a1b10.exr",
            "a02b1.exr",
            "a.exr",
            "ä.exr",
        ];
        let mut names = sorted;
        names.reverse();
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, sorted);
    }

    #[test]
    fn endings_count_in_any_case_and_hidden_files_do_not() {
        assert!(["a.exr", "a.b.HDR", "1.Png", "x.jpeg"].into_iter().all(is_picture));
        assert!(![".a.exr", "exr", ".exr", "a.exr.txt", "Thumbs.db", "a."].into_iter().any(is_picture));
    }
}
