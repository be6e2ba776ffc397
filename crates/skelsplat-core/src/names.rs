//! Enums whose variants have names in Python and in files.

/// Gives the variants of an enum their names; with the name of an argument, they are also found by
/// theirs; with `setting`, it is also a type of settings.
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
    ($argument:literal $type:ident $names:tt) => {
        named!($type $names);

        impl $type {
            /// The variant of this name.
            ///
            /// # Errors
            /// [`crate::Error::UnknownName`] for any other name, listing the known ones.
            pub fn by_name(name: &str) -> $crate::error::Result<Self> {
                let found = Self::ALL.iter().find(|(known, _)| *known == name);
                let unknown = || {
                    $crate::error::Error::unknown($argument, name, Self::NAMES.iter().copied())
                };
                found.map(|(_, variant)| *variant).ok_or_else(unknown)
            }
        }
    };
    (setting $($argument:literal)? $type:ident $names:tt) => {
        named!($($argument)? $type $names);

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
