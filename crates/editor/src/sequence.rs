//! Frames of a timeline as files: each whole or not there, one after the other.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clerestory_transport::basis::LightBasis;

use crate::black::{black_words, is_black};
use crate::export::{ExportOptions, ImageFormat, Picture};
use crate::look::{Look, Units};
use crate::output::{PendingFile, spare_inputs};
use crate::stills::{Size, Stills};

/// Most frames of a sequence.
pub const MOST_FRAMES: u32 = 1_000_000;
/// Most digits of the number of a frame: more than any number has, and far fewer than a name of a file may have.
const MOST_DIGITS: usize = 64;

/// Names of the files of a sequence: a path with `#` for the digits of the frame's number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
    /// Kind of the files.
    pub format: ImageFormat,
}

impl Pattern {
    /// Whether a path names many files.
    pub fn is_meant(path: &Path) -> bool {
        path.file_name().is_some_and(|name| name.to_string_lossy().contains('#'))
    }

    /// From a path such as `out/frame_####.png`.
    ///
    /// # Errors
    /// If its name has no `#`, too many or several groups of them, ends in neither `.png` nor `.exr`, or is no UTF-8.
    pub fn new(path: &Path) -> Result<Pattern> {
        let format = ImageFormat::of(path)?;
        let Some(name) = path.file_name().unwrap_or_default().to_str() else {
            bail!("cannot name frames by {}: the name is no UTF-8; give another one", path.display());
        };
        let digits = name.chars().filter(|c| *c == '#').count();
        let run = "#".repeat(digits);
        let Some((before, after)) = name.split_once(&run).filter(|_| (1..=MOST_DIGITS).contains(&digits)) else {
            bail!(
                "cannot name frames by {}: write # for the digits of their number, in one place, such as frame_####.png",
                path.display()
            );
        };
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        Ok(Pattern { folder, before: before.into(), digits, after: after.into(), format })
    }

    /// The file of a frame.
    pub fn file(&self, frame: u32) -> PathBuf {
        let Pattern { folder, before, digits, after, .. } = self;
        folder.join(format!("{before}{frame:0digits$}{after}"))
    }

    /// Whether a file of any frame is there.
    pub fn has_files(&self) -> bool {
        let is_frame = |name: &str| {
            let number = name.strip_prefix(&self.before).and_then(|rest| rest.strip_suffix(&self.after));
            number.is_some_and(|n| n.len() >= self.digits && n.bytes().all(|byte| byte.is_ascii_digit()))
        };
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.any(|entry| is_frame(&entry.file_name().to_string_lossy()))
    }
}

/// Number of the last frame of a look's timeline, counted from 0.
pub fn last_frame(look: &Look, fps: f32) -> u32 {
    (look.timeline.end_secs() * fps).round() as u32
}

/// Frames of a look that are to be written.
pub struct Sequence {
    /// The document with snapshots and timeline.
    pub look: Look,
    /// Names of the files.
    pub pattern: Pattern,
    /// First and last frame; frame n is at n / `fps` seconds.
    pub frames: RangeInclusive<u32>,
    /// Frames of a second.
    pub fps: f32,
    /// How the files are written.
    pub options: ExportOptions,
}

/// What was written of a sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Number of files: all, unless it was stopped.
    pub n_frames: u32,
    /// The first frame that is black although lights are on, and how many are.
    black: Option<(u32, u32)>,
}

impl Written {
    fn count(&mut self, frame: u32, is_black: bool) {
        self.n_frames += 1;
        if is_black {
            let (first, n_black) = self.black.unwrap_or((frame, 0));
            self.black = Some((first, n_black + 1));
        }
    }

    /// What is said where frames are black although lights of the basis are on.
    pub fn warning(&self, basis: &LightBasis) -> Option<String> {
        let (first, n_black) = self.black?;
        Some(match n_black {
            1 => black_words(&format!("frame {first} is"), basis),
            _ => black_words(&format!("{n_black} of {} frames, from frame {first} on, are", self.n_frames), basis),
        })
    }
}

impl Sequence {
    /// The whole timeline of a look, or what is asked of it.
    ///
    /// # Errors
    /// A look without a timeline, frames in the wrong order, or too many.
    pub fn new(
        look: Look,
        pattern: Pattern,
        frames: Option<RangeInclusive<u32>>,
        fps: Option<f32>,
    ) -> Result<Sequence> {
        if look.timeline.keys.is_empty() {
            bail!(
                "the look has no timeline, and # in the name asks for frames of one: add keys to it in the editor, or write them into its \
                 `timeline`; for one picture leave out #"
            );
        }
        let fps = fps.unwrap_or(look.timeline.fps);
        let frames = frames.unwrap_or(0..=last_frame(&look, fps));
        let n_frames = u64::from(*frames.end()) + 1 - u64::from(*frames.start()).min(u64::from(*frames.end()));
        if frames.is_empty() || n_frames > u64::from(MOST_FRAMES) {
            bail!("frames {} to {}: give 1 to {MOST_FRAMES} in rising order", frames.start(), frames.end());
        }
        Ok(Sequence { look, pattern, frames, fps, options: ExportOptions::default() })
    }

    /// Number of files.
    pub fn n_frames(&self) -> u32 {
        self.frames.end() - self.frames.start() + 1
    }

    /// Refuses to write over files that are read, and into folders that are not there or cannot be written.
    ///
    /// # Errors
    /// Names the file.
    pub fn spare(&self, inputs: &[(&'static str, &Path)]) -> Result<()> {
        let folder = if self.pattern.folder.as_os_str().is_empty() { Path::new(".") } else { &self.pattern.folder };
        if !folder.is_dir() {
            bail!("cannot write frames: the folder {} does not exist; create it first", folder.display());
        }
        let existing = self.frames.clone().map(|frame| self.pattern.file(frame)).filter(|file| file.exists());
        existing.into_iter().try_for_each(|file| spare_inputs(&file, inputs.iter().copied()))?;
        PendingFile::create(&self.pattern.file(*self.frames.start())).map(drop)
    }

    /// Writes the frames in order and answers what was written. `on_frame` is told how many are there.
    ///
    /// # Errors
    /// A failing device, a picture that cannot be shown, a full disk.
    pub fn write(
        &self,
        stills: &mut Stills,
        basis: &LightBasis,
        stop: &(dyn Fn() -> bool + Sync),
        on_frame: &mut dyn FnMut(u32),
    ) -> Result<Written> {
        let (mut last, mut written) = (None, Written::default());
        for frame in self.frames.clone() {
            if stop() {
                break;
            }
            let n_written = written.n_frames;
            let stopped = || format!("frame {frame} stopped the sequence, with {n_written} saved");
            let look = self.look.at(frame as f32 / self.fps, Some(basis));
            // Where nothing changes there is nothing to light.
            let kept = last.take().filter(|(of, _)| *of == look.lights).map(|(_, picture)| picture);
            let radiance = match kept {
                Some(radiance) => radiance,
                None => match stills.picture(&look, Size::Whole, stop).with_context(stopped)? {
                    Some(radiance) => radiance,
                    None => break,
                },
            };
            let irradiance = match self.options.irradiance || look.shows_irradiance(self.pattern.format) {
                true => stills.irradiance(&look, Size::Whole, stop).with_context(stopped)?,
                false => None,
            };
            if irradiance.is_none() && stop() {
                break;
            }
            let path = self.pattern.file(frame);
            let place = PendingFile::create(&path).with_context(stopped)?;
            let picture = Picture {
                radiance: &radiance,
                layers: &[],
                irradiance: irradiance.as_ref(),
                look: &look,
                units: Units::of(basis),
            };
            picture.write(place, self.pattern.format, &self.options).with_context(stopped)?;
            written.count(frame, is_black(&radiance, basis, &look.lights));
            last = Some((look.lights, radiance));
            on_frame(written.n_frames);
        }
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::sync::Arc;

    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;

    use super::*;
    use crate::look::timeline::{Ease, Key};
    use crate::stills::Subject;
    use crate::support::room_job;
    use crate::words::in_words;

    #[test]
    fn a_pattern_numbers_its_files() {
        let pattern = Pattern::new(Path::new("out/frame_####.v2.png")).unwrap();
        assert_eq!(pattern.file(7), Path::new("out/frame_0007.v2.png"));
        assert_eq!(pattern.file(123_456), Path::new("out/frame_123456.v2.png"));
        for bad in ["out/frame.png", "a_##_#.png", "frame_####.jpg", "##"] {
            assert!(Pattern::new(Path::new(bad)).is_err(), "{bad}");
        }
        // More digits than numbers can be written with.
        assert!(Pattern::new(Path::new(&format!("{}.png", "#".repeat(1 << 17)))).is_err());
        assert!(Pattern::is_meant(Path::new("a#.exr")) && !Pattern::is_meant(Path::new("a#/b.exr")));
    }

    #[cfg(unix)]
    #[test]
    fn frames_are_not_called_otherwise_than_asked() {
        use std::os::unix::ffi::OsStrExt;
        let path = Path::new(std::ffi::OsStr::from_bytes(b"caf\xe9_##.png"));
        let said = Pattern::new(path).unwrap_err().to_string();
        assert!(said.contains("no UTF-8"), "{said}");
    }

    #[test]
    fn a_sequence_spans_the_timeline_unless_told_otherwise() {
        let mut look = Look::default();
        look.keep("A");
        let pattern = || Pattern::new(Path::new("f#.exr")).unwrap();
        let Err(error) = Sequence::new(look.clone(), pattern(), None, None) else { panic!("it has no keys") };
        assert!(error.to_string().contains("no timeline, and # in the name"), "{error}");
        look.timeline.add(Key { secs: 2.0, look: "A".into(), ease: Ease::Smooth });
        let of = |frames, fps| Sequence::new(look.clone(), pattern(), frames, fps);
        assert_eq!(of(None, None).unwrap().frames, 0..=48);
        assert_eq!(of(None, Some(10.0)).unwrap().n_frames(), 21);
        assert_eq!(of(Some(5..=9), None).unwrap().n_frames(), 5);
        assert!(of(Some(0..=u32::MAX), None).is_err(), "too many");
    }

    #[test]
    fn black_frames_are_counted_from_the_first_on() {
        let (mut written, basis) = (Written::default(), LightBasis::default());
        [false, false, true].into_iter().zip(5..).for_each(|(is_black, frame)| written.count(frame, is_black));
        assert!(written.warning(&basis).unwrap().starts_with("frame 7 is black: "));
        written.count(8, true);
        assert!(written.warning(&basis).unwrap().starts_with("2 of 4 frames, from frame 7 on, are black: "));
        assert_eq!((Written::default().warning(&basis), written.n_frames), (None, 4));
    }

    #[test]
    fn a_frame_that_cannot_be_lit_is_named() {
        let config = BakeConfig { spp: 1, tolerance_db: 10.0, ..BakeConfig::default() };
        let job = room_job(Film { width: 16, height: 12 }, config);
        let mut bake = job.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
        // There are lights, and no columns of theirs.
        bake.groups.clear();
        let basis = bake.header.basis.clone();
        let mut stills = Stills::new(Arc::new(Subject { bake, view: None }), None);
        let (folder, mut look) = (tempfile::tempdir().unwrap(), Look::default());
        look.keep("A");
        look.timeline.add(Key { secs: 1.0, look: "A".into(), ease: Ease::Smooth });
        let pattern = Pattern::new(&folder.path().join("f##.exr")).unwrap();
        let sequence = Sequence::new(look, pattern, Some(3..=4), None).unwrap();
        let error = sequence.write(&mut stills, &basis, &|| false, &mut |_| {}).unwrap_err();
        assert!(in_words(&error).starts_with("frame 3 stopped the sequence, with 0 saved: "), "{error:?}");
    }

    #[test]
    fn inputs_are_spared_by_every_frame() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("f03.exr");
        std::fs::write(&input, b"bake").unwrap();
        let mut look = Look::default();
        look.keep("A");
        look.timeline.add(Key { secs: 1.0, look: "A".into(), ease: Ease::Smooth });
        let of = |name: &str| {
            let pattern = Pattern::new(&folder.path().join(name)).unwrap();
            Sequence::new(look.clone(), pattern, None, None).unwrap()
        };
        let inputs = [("transport", input.as_path())];
        assert!(of("f##.exr").spare(&inputs).unwrap_err().to_string().contains("would overwrite the transport"));
        of("g##.exr").spare(&inputs).unwrap();
        assert!(of("none/g##.exr").spare(&inputs).is_err());
        std::fs::create_dir(folder.path().join("h00.exr")).unwrap();
        let said = of("h##.exr").spare(&inputs).unwrap_err().to_string();
        assert!(said.contains("it is a folder"), "what cannot be written is known before anything is lit: {said}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
    }
}
