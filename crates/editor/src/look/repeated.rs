//! Members that stand twice in an object of a look: who reads JSON takes the last one without a word.

use std::collections::BTreeSet;
use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};

use super::place::{self, Step};

/// Places that are told at most.
const MOST_TOLD: usize = 16;

/// A sentence for each member of a valid document that another one of its name follows.
pub(super) fn warnings(text: &str) -> Vec<String> {
    let (mut steps, mut found) = (Vec::new(), Vec::new());
    let walk = Walk { steps: &mut steps, found: &mut found };
    // What is not valid was told by who read the values.
    if walk.deserialize(&mut serde_json::Deserializer::from_str(text)).is_err() {
        return Vec::new();
    }
    let sentence = |steps: &Vec<Step>| {
        // What stands in an object that another one of its name follows counts for nothing.
        let line = place::line_and_column(text, place::offset(text.as_bytes(), steps)?).0;
        Some(format!("the look has `{}` more than once; the last one, in line {line}, counts", place::path(steps)))
    };
    found.iter().filter_map(sentence).collect()
}

/// Goes through a document, and notes what is repeated.
struct Walk<'a> {
    steps: &'a mut Vec<Step>,
    found: &'a mut Vec<Vec<Step>>,
}

impl Walk<'_> {
    fn deeper(&mut self) -> Walk<'_> {
        Walk { steps: self.steps, found: self.found }
    }
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, value: D) -> Result<(), D::Error> {
        value.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut list: A) -> Result<(), A::Error> {
        for item in 0.. {
            self.steps.push(Step::Item(item));
            let value = list.next_element_seed(self.deeper())?;
            self.steps.pop();
            if value.is_none() {
                break;
            }
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut object: A) -> Result<(), A::Error> {
        let mut names = BTreeSet::new();
        while let Some(name) = object.next_key::<String>()? {
            self.steps.push(Step::Key(name.clone()));
            if !names.insert(name) && self.found.len() < MOST_TOLD && !self.found.contains(self.steps) {
                self.found.push(self.steps.clone());
            }
            object.next_value_seed(self.deeper())?;
            self.steps.pop();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::look::Look;

    #[test]
    fn members_that_stand_twice_are_told_with_the_line_that_counts() {
        let json = r#"{"clerestory": 1,
            "lights": {"a": {"intensity": 1}, "b": {"intensity": 2}},
            "lamps": [{"key": "L", "type": "point", "position": [0, 1, 0], "strength": 800,
                "strength": 8, "muted": true,
                "strength": 80}],
            "lights": {"a": {"intensity": 3}}}"#;
        let (look, warnings) = Look::from_json(json).unwrap();
        assert_eq!((look.lights.lamps[0].strength, look.lights.lights.len()), (80.0, 1));
        assert_eq!(
            warnings,
            [
                "the look has `lamps[0].strength` more than once; the last one, in line 5, counts",
                "the look has `lights` more than once; the last one, in line 6, counts",
            ]
        );
        let replaced = "{\"clerestory\": 1, \"lights\": {\"a\": {}, \"a\": {}},\n\"lights\": {\"b\": {}}}";
        let (_, warnings) = Look::from_json(replaced).unwrap();
        assert_eq!(warnings, ["the look has `lights` more than once; the last one, in line 2, counts"]);
        let (_, none) = Look::from_json(&look.to_json()).unwrap();
        assert!(none.is_empty(), "{none:?}");
        let many: String = (0..99).map(|_| "\"x\": [[1, -1.5, null]], ").collect();
        let (_, warnings) = Look::from_json(&format!("{{{many}\"clerestory\": 1}}")).unwrap();
        assert_eq!(warnings.len(), 2, "once, and that it is unknown: {warnings:?}");
    }
}
