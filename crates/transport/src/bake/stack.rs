//! Bakes of measured stacks: pictures of one view, each under one light, are the columns of a matrix that needs no tracing.
//!
//! Both halves of the matrix are the same numbers: what was photographed is what there is. So the error of sampling is 0,
//! that of truncation is exact, and the half of a tolerance that a traced bake leaves to noise goes to truncation too.
//! A stack is never in memory as a whole: it is read once to learn the brightness of its columns, and once more for each band
//! of rows beyond the first that [`StackJob::memory_bytes`] holds.

mod band;
mod run;

use std::ops::{ControlFlow, Range};
use std::sync::{Arc, Mutex, PoisonError};

use clerestory_nystrom::rivals::Method;
use rayon::prelude::*;

use super::{Bake, BakeConfig, BakeError, BakeEvent, BakeHeader, check_block, check_tolerance};
use crate::basis::{LightBasis, LightSource, SourceKind};
use crate::camera::Film;
use crate::fingerprint::digest;
use crate::import::stack::{ImageStack, StackError};
use crate::matrix::{peak, scale_of_peaks};
use crate::skips::{Skips, Spared};
use band::Band;

/// Bytes of pixels in memory at a time, unless a single row of blocks has more.
pub const MEMORY_BYTES: usize = 1 << 30;
/// Pixels that tell how bright a picture is.
const PEAK_PIXELS: usize = 1 << 20;
/// Scales that no factor of 32 bits overflows with.
const SCALES: std::ops::RangeInclusive<f32> = 1e-30..=1e30;
/// Share of the progress that reading the pictures counts for.
const READING: f32 = 0.2;

/// A stack and how exactly it is baked.
#[derive(Clone, Debug)]
pub struct StackJob {
    /// The pictures.
    pub stack: Arc<ImageStack>,
    /// Truncation error at which a block is done, in dB: 10·log10(pk² / mean ΔT²).
    pub tolerance_db: f32,
    /// What makes factors of a block; all but the default are there for comparison.
    pub method: Method,
    /// Side of a block in pixels, one of [`SIDES`](super::SIDES).
    pub block: u32,
    /// Same seed, same bytes.
    pub seed: u64,
    /// Bytes of pixels in memory at a time, such as [`MEMORY_BYTES`]; the result does not depend on it.
    pub memory_bytes: usize,
}

/// A stack that was read once: its columns are known.
pub struct SurveyedStack {
    job: StackJob,
    header: BakeHeader,
    digests: Vec<u64>,
    /// The middle of the pictures, kept from reading them.
    first: Band,
    n_negative: u64,
    n_encoded: usize,
    /// What is odd about single pictures, in words, and how many it is said of.
    remarks: Vec<(String, usize)>,
}

/// What is learned of a picture when it is read for the first time.
struct Survey {
    digest: u64,
    peak: f32,
    n_negative: u64,
    was_encoded: bool,
    remark: Option<String>,
    column: Vec<f32>,
}

impl StackJob {
    /// Bakes. `on_event` may ask to stop; then the result is `None`.
    ///
    /// # Errors
    /// See [`BakeError`].
    pub fn run(self, mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send) -> Result<Option<Bake>, BakeError> {
        match self.survey(&mut on_event)? {
            Some(surveyed) => surveyed.run(on_event),
            None => Ok(None),
        }
    }

    /// Reads every picture once. `on_event` hears of the progress and may ask to stop; then the result is `None`.
    ///
    /// # Errors
    /// A tolerance or blocks out of range, or a picture that cannot be used.
    pub fn survey(
        self,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send + ?Sized),
    ) -> Result<Option<SurveyedStack>, BakeError> {
        check_tolerance(self.tolerance_db)?;
        check_block(self.block)?;
        let rows = self.bands().swap_remove(0);
        let n_images = self.stack.images.len();
        let heard = Mutex::new((on_event, 0usize));
        let survey = |nth: usize| -> Result<Survey, Halt> {
            let survey = self.survey_image(nth, &rows)?;
            let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
            heard.1 += 1;
            let done = READING * heard.1 as f32 / n_images as f32;
            match (heard.0)(BakeEvent::Progress { pass: 0, done, secs_left: None }) {
                ControlFlow::Continue(()) => Ok(survey),
                ControlFlow::Break(()) => Err(Halt::Asked),
            }
        };
        match (0..n_images).into_par_iter().map(survey).collect::<Result<Vec<Survey>, Halt>>() {
            Ok(surveys) => Ok(Some(self.surveyed(rows, surveys))),
            Err(Halt::Asked) => Ok(None),
            Err(Halt::Failed(error)) => Err(error.into()),
        }
    }

    /// Whether what is in memory at once, a row of blocks of every picture at the least, fits a machine that has so many bytes, where
    /// that is known.
    ///
    /// # Errors
    /// [`BakeError::Config`] where it does not.
    pub fn check_memory(&self, there: Option<u64>) -> Result<(), BakeError> {
        let (Film { width, height }, n_images) = (self.stack.film, self.stack.images.len());
        let n_rows = height.min(self.block);
        let least = u64::from(width) * u64::from(n_rows) * (size_of::<[f32; 3]>() * n_images) as u64;
        match there.filter(|there| least > *there) {
            None => Ok(()),
            Some(there) => Err(BakeError::Config {
                what: format!(
                    "{n_rows} rows of pixels of {n_images} pictures take {} MB at once, and this machine has {} MB of memory; \
                     split the folder into several, or make the pictures smaller",
                    least.div_ceil(1 << 20),
                    there >> 20
                ),
            }),
        }
    }

    fn survey_image(&self, nth: usize, rows: &Range<u32>) -> Result<Survey, StackError> {
        let (picture, bytes) = self.stack.read(&self.stack.images[nth])?;
        Ok(Survey {
            digest: digest(&bytes),
            peak: peak_of(&picture.pixels),
            n_negative: picture.pixels.iter().flatten().filter(|value| **value < 0.0).count() as u64,
            was_encoded: picture.was_encoded,
            remark: picture.remark.clone(),
            column: band::column(&picture, rows),
        })
    }

    fn surveyed(self, rows: Range<u32>, surveys: Vec<Survey>) -> SurveyedStack {
        let peaks: Vec<f32> = surveys.iter().map(|survey| survey.peak).collect();
        let scale = scale_of_peaks(&peaks, &vec![1.0; peaks.len()], &vec![false; peaks.len()]);
        let digests: Vec<u64> = surveys.iter().map(|survey| survey.digest).collect();
        let header =
            self.header(&digests, scale.into_iter().map(|s| s.clamp(*SCALES.start(), *SCALES.end())).collect());
        SurveyedStack {
            n_negative: surveys.iter().map(|survey| survey.n_negative).sum(),
            n_encoded: surveys.iter().filter(|survey| survey.was_encoded).count(),
            remarks: counted(surveys.iter().filter_map(|survey| survey.remark.as_deref())),
            first: Band { rows, columns: surveys.into_iter().map(|survey| survey.column).collect() },
            job: self,
            header,
            digests,
        }
    }

    fn header(&self, digests: &[u64], column_scale: Vec<f32>) -> BakeHeader {
        let ImageStack { film, images, .. } = &*self.stack;
        let source = |(key, column): (&str, u32)| LightSource::plain(key, SourceKind::Image, column..column + 1);
        let keys = images.iter().map(|image| image.key.as_str());
        let words: Vec<u8> = digests.iter().flat_map(|digest| digest.to_le_bytes()).collect();
        BakeHeader {
            scene: self.stack.name(),
            fingerprint: format!("{:016x}", digest(&words)),
            camera: String::new(),
            view: None,
            width: film.width,
            height: film.height,
            tile: self.block,
            // Nothing is sampled.
            config: BakeConfig {
                spp: 0,
                tolerance_db: self.tolerance_db,
                bounces: None,
                seed: self.seed,
                method: self.method,
                denoise: false,
                block: self.block,
                ..BakeConfig::default()
            },
            basis: LightBasis::new(keys.zip(0..).map(source).collect()),
            column_scale,
            sky_reach: Vec::new(),
            sharing_bias: None,
            preview_blocks: 0,
            ended_by_time: false,
            together: None,
            column_error: Vec::new(),
            irradiance: Vec::new(),
            patches: None,
            skips: Skips::default(),
            spared: Spared::default(),
            grounds: None,
        }
    }

    /// Rows of pixels that are in memory together, those in the middle of the picture first.
    fn bands(&self) -> Vec<Range<u32>> {
        let Film { width, height } = self.stack.film;
        let bytes_per_row = width as usize * size_of::<[f32; 3]>() * self.stack.images.len();
        let n_tiles = (self.memory_bytes / bytes_per_row / self.block as usize).max(1);
        let n_rows = u32::try_from(n_tiles).unwrap_or(u32::MAX).saturating_mul(self.block);
        let mut bands: Vec<Range<u32>> =
            (0..height).step_by(n_rows as usize).map(|first| first..first.saturating_add(n_rows).min(height)).collect();
        bands.sort_by_key(|band| (i64::from(band.start) + i64::from(band.end) - i64::from(height)).abs());
        bands
    }
}

/// Why reading ended early.
enum Halt {
    Asked,
    Failed(StackError),
}

impl From<StackError> for Halt {
    fn from(error: StackError) -> Halt {
        Halt::Failed(error)
    }
}

/// The peak of a picture's values, by how far they are from black: a picture may be darker than that in most places.
fn peak_of(pixels: &[[f32; 3]]) -> f32 {
    let every = pixels.len().div_ceil(PEAK_PIXELS);
    let values = pixels.iter().step_by(every).flatten().map(|value| value.abs());
    peak(&mut values.collect::<Vec<f32>>(), 0.0)
}

impl SurveyedStack {
    /// What the bake will be of.
    pub fn header(&self) -> &BakeHeader {
        &self.header
    }

    /// What was done with the numbers of the pictures, in words.
    pub fn remarks(&self) -> Vec<String> {
        let (folder, n_images) = (self.job.stack.folder.display(), self.job.stack.images.len());
        let encoded = (self.n_encoded > 0).then(|| {
            format!(
                "{folder}: {} of {n_images} pictures are PNG or JPEG; their values were taken as sRGB and made linear, \
                 white being 1",
                self.n_encoded
            )
        });
        let negative = (self.n_negative > 0).then(|| {
            format!("{folder}: {} values of its pixels are negative; they count as they are", self.n_negative)
        });
        let odd = self.remarks.iter().map(|(remark, n)| format!("{folder}: {n} of {n_images} pictures: {remark}"));
        encoded.into_iter().chain(negative).chain(odd).collect()
    }
}

/// Different words in the order in which they come first, and how often each comes.
fn counted<'a>(words: impl Iterator<Item = &'a str>) -> Vec<(String, usize)> {
    let mut counts: Vec<(String, usize)> = Vec::new();
    for word in words {
        match counts.iter_mut().find(|(other, _)| other == word) {
            Some((_, n)) => *n += 1,
            None => counts.push((word.to_owned(), 1)),
        }
    }
    counts
}

#[cfg(test)]
mod tests;
