//! Numbers of a text file, each with its line, so that every complaint names one.

use std::fmt::Display;

/// Brightest intensity that is believed, candela: a lighthouse has 10⁷, and a flux of more could not be told.
const MAX_CANDELA: f32 = 1e12;
/// Least distance of two angles, degrees: closer ones become one in single precision.
pub(super) const MIN_STEP_DEG: f64 = 1e-3;
/// Intensities below 0 by no more than this share of the largest are noise of the measurement.
const NOISE: f64 = 0.01;

/// What is wrong in a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// From 1.
    pub line: usize,
    pub reason: String,
}

/// What a comma means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Comma {
    /// It stands between numbers.
    Separates,
    /// It is a decimal point.
    Decimal,
}

/// Reads numbers one after the other.
pub(super) struct Numbers<'a> {
    words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    comma: Comma,
    /// Line of the last number, from 1.
    pub line: usize,
}

impl<'a> Numbers<'a> {
    /// Numbers of all lines from index `first` on.
    #[expect(clippy::arithmetic_side_effects, reason = "a line of a text in memory")]
    pub fn new(lines: &'a [&'a str], first: usize, comma: Comma) -> Numbers<'a> {
        let between = move |c: char| c.is_whitespace() || (c == ',' && comma == Comma::Separates);
        let words = lines.iter().enumerate().skip(first).flat_map(move |(index, line)| {
            line.split(between).filter(|word| !word.is_empty()).map(move |word| (index + 1, word))
        });
        Numbers { words: Box::new(words), comma, line: lines.len().max(1) }
    }

    /// The next number.
    pub fn next(&mut self, what: impl Display) -> Result<f64, Fault> {
        let Some((line, word)) = self.words.next() else {
            return Err(Fault { line: self.line, reason: format!("{what} is missing") });
        };
        self.line = line;
        parsed(word, self.comma).ok_or_else(|| {
            let word: String = word.chars().take(40).collect();
            self.fault(format!("{word:?} is no number; {what} should be here"))
        })
    }

    /// A whole number within a range.
    pub fn count(&mut self, what: &str, range: std::ops::RangeInclusive<usize>) -> Result<usize, Fault> {
        let number = self.next(what)?;
        whole(number, &range).ok_or_else(|| self.out_of(number, what, &range))
    }

    /// So many numbers.
    pub fn list(&mut self, n: usize, what: &str) -> Result<Vec<f64>, Fault> {
        (1..=n).map(|nth| self.next(format_args!("{what} {nth} of {n}"))).collect()
    }

    /// Angles within a range, degrees, none of which is less than the one before it.
    pub fn angles(&mut self, n: usize, what: &str, range: (f64, f64)) -> Result<Vec<f64>, Fault> {
        let mut angles = Vec::new();
        for nth in 1..=n {
            let angle = self.next(format_args!("{what} {nth} of {n}"))?;
            if !(range.0..=range.1).contains(&angle) {
                let reason = format!("{what} {angle}° is not within {}° to {}°", range.0, range.1);
                return Err(self.fault(reason));
            }
            if angles.last().is_some_and(|&last| angle - last <= -MIN_STEP_DEG) {
                return Err(self.fault(format!("{what} {angle}° is not larger than the one before it")));
            }
            angles.push(angle);
        }
        Ok(angles)
    }

    /// So many intensities times a scale, in candela, and how many of them were less than 0, as noise leaves them: those are 0.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "values in single precision; a count that is cut off is not equal any more"
    )]
    pub fn candela(&mut self, n: usize, scale: f64) -> Result<(Vec<f32>, usize), Fault> {
        let fault =
            |line, value| Fault { line, reason: format!("the intensity {value} (times {scale}) is not possible") };
        let (mut candela, mut most, mut negative) = (Vec::new(), 0.0_f64, Vec::new());
        for nth in 1..=n {
            let value = self.next(format_args!("intensity {nth} of {n}"))?;
            let scaled = (value.max(0.0) * scale) as f32;
            if !(0.0..=MAX_CANDELA).contains(&scaled) {
                return Err(fault(self.line, value));
            }
            if value < 0.0 {
                negative.push((self.line, value));
            }
            most = most.max(value);
            candela.push(scaled);
        }
        match negative.iter().find(|(_, value)| *value < -NOISE * most) {
            Some(&(line, value)) => Err(fault(line, value)),
            None => Ok((candela, negative.len())),
        }
    }

    /// A factor of the intensities: more than 0.
    pub fn factor(&mut self, what: &str) -> Result<f64, Fault> {
        let factor = self.next(what)?;
        if factor > 0.0 { Ok(factor) } else { Err(self.fault(format!("{what} is {factor}; it must be more than 0"))) }
    }

    /// How many numbers follow.
    pub fn n_left(self) -> usize {
        let comma = self.comma;
        self.words.filter(|(_, word)| parsed(word, comma).is_some()).count()
    }

    /// A fault in the line of the last number.
    pub fn fault(&self, reason: String) -> Fault {
        Fault { line: self.line, reason }
    }

    fn out_of(&self, number: f64, what: &str, range: &std::ops::RangeInclusive<usize>) -> Fault {
        self.fault(format!("{what} is {number}; it must be a whole number from {} to {}", range.start(), range.end()))
    }
}

fn parsed(word: &str, comma: Comma) -> Option<f64> {
    let number = match comma {
        Comma::Separates => word.parse::<f64>(),
        Comma::Decimal => word.replace(',', ".").parse::<f64>(),
    };
    number.ok().filter(|number| number.is_finite())
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "values in single precision; a count that is cut off is not equal any more"
)]
fn whole(number: f64, range: &std::ops::RangeInclusive<usize>) -> Option<usize> {
    let whole = number as usize;
    (whole as f64 == number && range.contains(&whole)).then_some(whole)
}
