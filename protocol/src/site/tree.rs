//! The parsed text as a tree whose every value knows its place and its path.

use std::ops::Range;
use toml::de::{DeInteger, DeValue};

/// As many items as the longest list may have (lasers, zones); the schema refuses longer ones.
const ITEMS_MAX: usize = 256;

/// A value of the file. Getters are lenient: what is absent or of another type is `None`, so that
/// one mistake does not hide the next.
#[derive(Debug, Clone)]
pub(super) struct Node<'t> {
    pub value: &'t DeValue<'t>,
    /// Bytes of the value in the text; of the header for a `[table]`.
    pub span: Range<usize>,
    /// `laser[1].source.rate_hz`; empty for the whole file.
    pub path: String,
}

impl<'t> Node<'t> {
    pub fn root(value: &'t DeValue<'t>) -> Self {
        Self { value, span: 0..0, path: String::new() }
    }

    /// Path of a key of this table.
    pub fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// The value under a key of this table.
    pub fn get(&self, key: &str) -> Option<Self> {
        let child = self.value.get(key)?;
        Some(Self { value: child.get_ref(), span: child.span(), path: self.path_of(key) })
    }

    /// The value under a key of this table; the table itself if the key is absent.
    pub fn get_or_self(&self, key: &str) -> Self {
        self.get(key).unwrap_or_else(|| self.clone())
    }

    /// Keys of this table with the place of each, in the order of the text.
    pub fn keys(&self) -> Vec<(&'t str, Range<usize>)> {
        let Some(table) = self.value.as_table() else { return Vec::new() };
        let mut keys: Vec<_> =
            table.iter().map(|(key, _)| (key.get_ref().as_ref(), key.span())).collect();
        keys.sort_by_key(|(_, span)| span.start);
        keys
    }

    /// The items of this list.
    pub fn items(&self) -> Vec<Self> {
        let Some(array) = self.value.as_array() else { return Vec::new() };
        let item = |(index, child): (usize, &'t toml::Spanned<DeValue<'t>>)| Self {
            value: child.get_ref(),
            span: child.span(),
            path: format!("{}[{index}]", self.path),
        };
        array.iter().enumerate().map(item).collect()
    }

    /// The items of the list under a key, for the rules: at most [`ITEMS_MAX`], so that a rule which
    /// compares all with all stays quick whatever the file.
    pub fn list(&self, key: &str) -> Vec<Self> {
        let mut items = self.get(key).map(|node| node.items()).unwrap_or_default();
        items.truncate(ITEMS_MAX);
        items
    }

    /// The text under a key.
    pub fn text(&self, key: &str) -> Option<(&'t str, Self)> {
        let node = self.get(key)?;
        Some((node.value.as_str()?, node))
    }

    /// The number under a key.
    pub fn number(&self, key: &str) -> Option<f64> {
        number(self.get(key)?.value)
    }

    /// The number under a key, or its default.
    pub fn number_or(&self, key: &str, default: f64) -> f64 {
        self.number(key).unwrap_or(default)
    }

    /// The pair of numbers in this list.
    pub fn pair(&self) -> Option<[f64; 2]> {
        let array = self.value.as_array()?;
        let [x, y] = array.get(..)? else { return None };
        Some([number(x.get_ref())?, number(y.get_ref())?])
    }
}

/// A finite number, whole or not.
pub(super) fn number(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Integer(integer) => whole(integer)? as f64,
        DeValue::Float(float) => float.as_str().parse().ok()?,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

/// A whole number, if it fits.
pub(super) fn whole(integer: &DeInteger<'_>) -> Option<i128> {
    i128::from_str_radix(integer.as_str(), integer.radix()).ok()
}
