//! Errors and remarks as sentences.

use anyhow::Error;
use clerestory_transport::lamps::Lacking;

/// An error and its causes; a cause that the sentence before already told is not repeated.
pub fn in_words(error: &Error) -> String {
    let mut sentences: Vec<String> = Vec::new();
    for cause in error.chain().map(ToString::to_string) {
        if !sentences.last().is_some_and(|told| told.contains(&cause)) {
            sentences.push(cause);
        }
    }
    sentences.join(": ")
}

/// Text without the byte order mark that some editors write before it.
pub fn unmarked(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// How many columns a matrix has.
pub fn columns_words(n: u64) -> String {
    if n == 1 { "1 column".into() } else { format!("{n} columns") }
}

/// That a share of a lamp's light meets mirrors and clear glass, which throw it on unseen; `key` is the lamp's.
fn caustics_words(key: &str, share: f32) -> String {
    format!(
        "`{key}` sends {:.0} % of its light onto mirrors and clear glass, whose caustics are not carried",
        100.0 * share
    )
}

/// That a share of a lamp's light is missing which panes and coats mirror; `key` is the lamp's.
fn mirrored_words(key: &str, share: f32) -> String {
    format!(
        "panes of glass and smooth coats mirror {:.0} % of the light of `{key}` onto other surfaces, which is missing",
        100.0 * share
    )
}

/// A sentence for each kind of light that a lamp lacks: caustics, and what panes and coats mirror.
pub fn lacking_words(key: &str, lacking: &Lacking) -> [Option<String>; 2] {
    let caustics = (lacking.caustic > 0.0).then(|| caustics_words(key, lacking.caustic));
    let mirrored = (lacking.mirrored > 0.0).then(|| mirrored_words(key, lacking.mirrored));
    [caustics, mirrored]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_that_a_lamp_lacks_is_told_by_its_kind() {
        let lacking = Lacking { caustic: 0.17, mirrored: 0.0 };
        let told = "`bulb` sends 17 % of its light onto mirrors and clear glass, whose caustics are not carried";
        assert_eq!(lacking_words("bulb", &lacking), [Some(told.to_owned()), None]);
        assert_eq!(lacking_words("bulb", &Lacking::default()), [None, None]);
    }

    #[test]
    fn one_column_is_not_told_as_several() {
        assert_eq!([0, 1, 18].map(columns_words), ["0 columns", "1 column", "18 columns"]);
    }

    #[test]
    fn a_cause_that_was_told_is_not_told_again() {
        let error = Error::msg("no such file").context("cannot read a: no such file").context("cannot open a");
        assert_eq!(in_words(&error), "cannot open a: cannot read a: no such file");
    }
}
