//! Enums whose variants have names in Python and in files.

use crate::error::{Error, Result};

/// Gives the variants of an enum their names; with `setting`, it is also a type of settings.
macro_rules! named {
    ($type:ident { $($variant:ident: $name:literal),+ $(,)? }) => {
        impl $type {
            /// Every variant with its name.
            pub const ALL: &'static [(&'static str, Self)] = &[$(($name, Self::$variant)),+];
            /// The names of all variants.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// The name used in Python and in files.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }
    };
    (setting $type:ident $names:tt) => {
        named!($type $names);

        impl Parameter for $type {
            const KIND: Kind = Kind::Name(Self::NAMES);
            fn to_value(&self) -> Value {
                Value::Name(self.name())
            }
            fn of_value(value: &Value) -> Option<Self> {
                Self::ALL.iter().map(|(_, known)| *known).find(|known| *value == known.to_value())
            }
        }
    };
}
pub(crate) use named;

/// The variant of this name, for the argument `argument`.
/// Errors: [`Error::UnknownName`] listing the known names.
pub(crate) fn by_name<T: Copy>(
    argument: &'static str,
    name: &str,
    all: &[(&'static str, T)],
) -> Result<T> {
    let found = all.iter().find(|(known, _)| *known == name);
    found.map(|(_, variant)| *variant).ok_or_else(|| Error::UnknownName {
        argument,
        name: name.to_owned(),
        known: all.iter().map(|(known, _)| (*known).to_owned()).collect(),
    })
}
