//! Which look of a document lights a picture: the present one, a snapshot, a moment of its timeline, or a preset.

use anyhow::{Result, bail};
use clap::Args;
use clerestory_transport::basis::LightBasis;

use crate::look::Look;
use crate::look::presets::Preset;
use crate::look::timeline::SECS;

/// What is chosen of a look.
#[derive(Clone, Debug, Default, Args)]
pub struct LookChoice {
    /// Snapshot of the look to light it with, by its name; `info FILE.look` lists them.
    #[arg(long, value_name = "NAME", requires = "look", conflicts_with = "at")]
    pub name: Option<String>,
    /// Moment of the look's timeline to light it with, in seconds.
    #[arg(long, value_name = "SECS", requires = "look", value_parser = parse_secs, allow_negative_numbers = true)]
    pub at: Option<f32>,
    /// Light it by what the scene has: `day`, `dusk`, `night` or `exhibition`; lamps of the look stay where they are.
    #[arg(long, value_name = "PRESET", value_parser = parse_preset)]
    pub preset: Option<Preset>,
}

impl LookChoice {
    /// What was chosen of a document. Without the lights of a scene presets change nothing, and a moment takes all lights to
    /// be white in the file.
    ///
    /// # Errors
    /// A snapshot that the document does not have, or a moment of none.
    pub fn of(&self, document: &Look, basis: Option<&LightBasis>) -> Result<Look> {
        let look = match (&self.name, self.at) {
            (Some(name), _) => document.named(name)?,
            (None, Some(_)) if document.timeline.keys.is_empty() => {
                bail!("the look has no timeline to be at a moment of; leave out --at, or add keys in the editor")
            }
            (None, Some(secs)) => document.at(secs, basis),
            (None, None) => document.present(),
        };
        let look = match (self.preset, basis) {
            (Some(preset), Some(basis)) => preset.of(basis, &look).look(),
            _ => look,
        };
        // What the document makes of the scene and what it calls its lights belong to all of its looks.
        Ok(Look { names: document.names.clone(), scene: document.scene.clone(), ..look })
    }
}

fn parse_secs(text: &str) -> Result<f32, String> {
    let secs = text.parse::<f64>().ok().filter(|secs| SECS.contains(secs));
    secs.map(|secs| secs as f32).ok_or_else(|| format!("write seconds from {} to {}", SECS.start(), SECS.end()))
}

fn parse_preset(text: &str) -> Result<Preset, String> {
    let found = Preset::ALL.iter().find(|(_, name, _)| *name == text);
    let names = || Preset::ALL.map(|(_, name, _)| name).join(", ");
    found.map(|(preset, ..)| *preset).ok_or_else(|| format!("there are {}", names()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::timeline::{Ease, Key};

    #[test]
    fn lights_are_called_alike_whatever_is_chosen() {
        let mut document = Look::default();
        document.keep("Day");
        document.timeline.add(Key { secs: 1.0, look: "Day".into(), ease: Ease::Smooth });
        document.names.insert("lamp".into(), "Desk lamp".into());
        for choice in [
            LookChoice::default(),
            LookChoice { name: Some("Day".into()), ..LookChoice::default() },
            LookChoice { at: Some(0.5), ..LookChoice::default() },
            LookChoice { preset: Some(Preset::Night), ..LookChoice::default() },
        ] {
            let look = choice.of(&document, Some(&LightBasis::default())).unwrap();
            assert_eq!(look.name_of("lamp"), "Desk lamp", "{choice:?}");
        }
    }

    #[test]
    fn what_is_not_there_is_refused_in_words() {
        let choice = LookChoice { at: Some(1.0), ..LookChoice::default() };
        assert!(choice.of(&Look::default(), None).unwrap_err().to_string().contains("no timeline"));
        let choice = LookChoice { name: Some("Day".into()), ..LookChoice::default() };
        assert!(choice.of(&Look::default(), None).unwrap_err().to_string().contains("`Day`"));
        assert!(parse_preset("noon").unwrap_err().contains("exhibition") && parse_secs("-1").is_err());
    }
}
