//! Measured stacks: a folder of pictures of one thing, each under one light, as a light stage takes them \[Debevec2000\].
//!
//! Each picture is a column of the matrix, named by its file. Pictures are read when they are asked for: a stack holds no
//! pixels.

mod names;
mod pixels;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::files::read_at_most;
use crate::camera::Film;
use names::{Entry, entries};
pub use pixels::{Picture, decode_picture};

/// Largest file that is read.
const MAX_FILE_BYTES: u64 = 2 << 30;
/// Most pictures of a stack.
const MAX_IMAGES: usize = 1 << 14;
/// Most pixels of a picture, 8192 × 8192.
pub(crate) const MAX_PIXELS: u64 = 1 << 26;
/// Names of other files that are told.
const NAMES_TOLD: usize = 3;

/// Why a folder of pictures cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StackError {
    /// The system says no.
    #[error("cannot read `{path}`: {source}; check the path and that it may be read")]
    Read {
        /// Folder or file.
        path: PathBuf,
        /// Its answer.
        source: io::Error,
    },
    /// Something else than a folder.
    #[error("`{path}` is no folder; name the folder that holds one picture for each light")]
    NoFolder {
        /// What was named.
        path: PathBuf,
    },
    /// No picture in it.
    #[error(
        "`{folder}` holds no picture{others}; a stack is a folder of .exr, .hdr, .png or .jpg files, one for each light"
    )]
    NoImages {
        /// The folder.
        folder: PathBuf,
        /// What else it holds, in words.
        others: String,
    },
    /// More pictures than a matrix may have columns.
    #[error(
        "`{folder}` holds {n_images} pictures, and a stack has at most {MAX_IMAGES}; split it into several folders"
    )]
    TooMany {
        /// The folder.
        folder: PathBuf,
        /// How many there are.
        n_images: usize,
    },
    /// Two files with one key.
    #[error("`{first}` and `{second}` would both be the light `{key}`; move one of them to another folder")]
    SameKey {
        /// A file.
        first: PathBuf,
        /// Another one.
        second: PathBuf,
        /// Their names without the ending.
        key: String,
    },
    /// Pictures of different size.
    #[error(
        "`{first}` has {} × {} pixels but `{second}` has {} × {}; all pictures of a stack show the same view at one size",
        first_size[0], first_size[1], second_size[0], second_size[1]
    )]
    Sizes {
        /// The first picture.
        first: PathBuf,
        /// Its width and height.
        first_size: [u32; 2],
        /// The first picture of another size.
        second: PathBuf,
        /// Its width and height.
        second_size: [u32; 2],
    },
    /// A file that is no picture that can be read.
    #[error("cannot use the picture `{path}`: {reason}; repair it or move it to another folder")]
    Decode {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A picture that is not what it was when the work began.
    #[error("`{path}` was changed while it was read; run the same command again once nobody writes to it")]
    Changed {
        /// The file.
        path: PathBuf,
    },
}

/// One picture of a stack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StackImage {
    /// Name of its light: that of the file without the ending.
    pub key: String,
    /// The file.
    pub path: PathBuf,
}

/// A folder of pictures of one size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageStack {
    /// The folder.
    pub folder: PathBuf,
    /// Size of every picture in pixels.
    pub film: Film,
    /// Pictures in natural order of their names.
    pub images: Vec<StackImage>,
    /// Files and folders beside the pictures.
    pub passed_over: Vec<String>,
}

impl ImageStack {
    /// Lists a folder, and looks at the head of every picture in it.
    ///
    /// # Errors
    /// A folder without pictures, two pictures of one name, pictures of different size, or one that cannot be read.
    pub fn open(folder: &Path) -> Result<ImageStack, StackError> {
        let mut images = Vec::new();
        let mut passed_over = Vec::new();
        for entry in entries(folder)? {
            match entry {
                Entry::Picture(image) => images.push(image),
                Entry::Other(name) => passed_over.push(name),
            }
        }
        if images.is_empty() {
            let others = if passed_over.is_empty() { String::new() } else { format!(" ({})", listed(&passed_over)) };
            return Err(StackError::NoImages { folder: folder.into(), others });
        }
        if images.len() > MAX_IMAGES {
            return Err(StackError::TooMany { folder: folder.into(), n_images: images.len() });
        }
        let film = common_size(&images)?;
        Ok(ImageStack { folder: folder.into(), film, images, passed_over })
    }

    /// Name of the folder, for people.
    pub fn name(&self) -> String {
        let absolute = self.folder.canonicalize().unwrap_or_else(|_| self.folder.clone());
        absolute.file_name().map_or_else(|| self.folder.display().to_string(), |name| name.to_string_lossy().into())
    }

    /// What the folder holds beside pictures, in words; nothing where that is all.
    pub fn remarks(&self) -> Vec<String> {
        let others = (!self.passed_over.is_empty()).then(|| {
            format!("{}: {} passed over, being no pictures", self.folder.display(), listed(&self.passed_over))
        });
        others.into_iter().collect()
    }

    /// Reads a picture.
    ///
    /// # Errors
    /// A file that cannot be read, is no picture of the size of the stack, or has pixels that are no numbers.
    pub fn read(&self, image: &StackImage) -> Result<(Picture, Vec<u8>), StackError> {
        let bytes = read_at_most(&image.path, MAX_FILE_BYTES).map_err(cannot_read(&image.path))?;
        let refuse = |reason| StackError::Decode { path: image.path.clone(), reason };
        let picture = decode_picture(&bytes).map_err(refuse)?;
        if picture.size != [self.film.width, self.film.height] {
            return Err(StackError::Changed { path: image.path.clone() });
        }
        picture.check_finite().map_err(refuse)?;
        Ok((picture, bytes))
    }
}

/// The size that all pictures have.
fn common_size(images: &[StackImage]) -> Result<Film, StackError> {
    let size = |image: &StackImage| {
        let file = File::open(&image.path).map_err(cannot_read(&image.path))?;
        let refuse = |reason| StackError::Decode { path: image.path.clone(), reason };
        let n_bytes = file.metadata().map_err(cannot_read(&image.path))?.len();
        pixels::size(BufReader::new(file), n_bytes).map_err(refuse)
    };
    let sizes: Vec<Result<[u32; 2], StackError>> = images.par_iter().map(size).collect();
    let sizes = sizes.into_iter().collect::<Result<Vec<_>, _>>()?;
    match sizes.iter().position(|size| *size != sizes[0]) {
        Some(other) => Err(StackError::Sizes {
            first: images[0].path.clone(),
            first_size: sizes[0],
            second: images[other].path.clone(),
            second_size: sizes[other],
        }),
        None => Ok(Film { width: sizes[0][0], height: sizes[0][1] }),
    }
}

fn cannot_read(path: &Path) -> impl FnOnce(io::Error) -> StackError {
    let path = path.to_path_buf();
    move |source| StackError::Read { path, source }
}

/// How many files there are, and some of their names.
fn listed(names: &[String]) -> String {
    let told = names.iter().take(NAMES_TOLD).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = if names.len() > NAMES_TOLD { ", …" } else { "" };
    let files = if names.len() == 1 { "1 other file".into() } else { format!("{} other files", names.len()) };
    format!("{files} ({told}{more})")
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::{ImageFormat, Rgb, RgbImage};

    use super::*;

    fn png(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = io::Cursor::new(Vec::new());
        RgbImage::from_pixel(width, height, Rgb([255; 3])).write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    type Files<'a> = &'a [(&'a str, &'a [u8])];

    fn folder(files: Files) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        folder
    }

    #[test]
    fn pictures_come_in_natural_order_and_other_files_are_counted() {
        let picture = png(4, 3);
        let names = ["light_10.png", "light_2.PNG", "Thumbs.db", ".hidden.png", "notes.txt", "light_1.png"];
        let folder = folder(&names.map(|name| (name, picture.as_slice())));
        fs::create_dir(folder.path().join("raw.exr")).unwrap();
        let stack = ImageStack::open(folder.path()).unwrap();
        let keys: Vec<&str> = stack.images.iter().map(|image| image.key.as_str()).collect();
        assert_eq!(keys, ["light_1", "light_2", "light_10"]);
        assert_eq!(stack.film, Film { width: 4, height: 3 });
        let remark = stack.remarks().join("");
        assert!(remark.contains("4 other files (.hidden.png, Thumbs.db, notes.txt, …) passed over"), "{remark}");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_that_is_named_like_a_picture_is_passed_over() {
        let folder = folder(&[("a.png", &png(4, 3))]);
        let made = std::process::Command::new("mkfifo").arg(folder.path().join("b.png")).status().unwrap();
        assert!(made.success());
        let stack = ImageStack::open(folder.path()).unwrap();
        assert_eq!((stack.images.len(), stack.passed_over), (1, vec!["b.png".to_owned()]));
        std::os::unix::fs::symlink("nowhere.png", folder.path().join("c.png")).unwrap();
        let said = ImageStack::open(folder.path()).unwrap_err().to_string();
        assert!(said.contains("c.png`"), "{said}");
    }

    #[test]
    fn folders_that_are_no_stacks_are_refused_in_words() {
        let (small, large) = (png(4, 3), png(5, 3));
        let cases: [(Files, &[&str]); 6] = [
            (&[], &["holds no picture;", ".exr"]),
            (&[("a.txt", b"a"), ("b.tif", b"b")], &["holds no picture (2 other files (a.txt, b.tif))"]),
            (&[("a.png", &small), ("b.png", &small), ("c.png", &large)], &["a.png` has 4 × 3", "c.png` has 5 × 3"]),
            (&[("a.png", &small), ("a.jpg", &small)], &["a.jpg` and `", "a.png` would both be the light `a`"]),
            (&[("a.png", b"letter")], &["a.png`: it is neither"]),
            (&[("a.png", &small[..20])], &["a.png`:"]),
        ];
        for (files, words) in cases {
            let folder = folder(files);
            let said = ImageStack::open(folder.path()).unwrap_err().to_string();
            assert!(words.iter().all(|word| said.contains(word)), "{said} should say {words:?}");
        }
        let nowhere = ImageStack::open(Path::new("/nowhere")).unwrap_err().to_string();
        assert!(nowhere.contains("check the path"), "{nowhere}");
        let folder = folder(&[("a.png", &small)]);
        assert!(matches!(ImageStack::open(&folder.path().join("a.png")), Err(StackError::NoFolder { .. })));
    }

    #[test]
    fn a_picture_that_is_cut_off_or_changed_is_named_when_it_is_read() {
        let whole = png(64, 64);
        let folder = folder(&[("a.png", &whole), ("b.png", &whole)]);
        let stack = ImageStack::open(folder.path()).unwrap();
        assert!(stack.read(&stack.images[0]).unwrap().0.pixels.iter().all(|pixel| *pixel == [1.0; 3]));
        fs::write(&stack.images[0].path, &whole[..whole.len() - 30]).unwrap();
        let said = stack.read(&stack.images[0]).unwrap_err().to_string();
        assert!(said.contains("a.png`") && said.contains("repair"), "{said}");
        fs::write(&stack.images[1].path, png(8, 8)).unwrap();
        assert!(matches!(stack.read(&stack.images[1]), Err(StackError::Changed { .. })));
    }
}
