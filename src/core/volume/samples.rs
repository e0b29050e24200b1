//! Samples of the eight supported types, as native-endian typed buffers.

use bytemuck::Pod;

/// The type of a volume's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum SampleType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl SampleType {
    /// Every type, in the order of the declaration.
    pub const ALL: [SampleType; 8] = [
        SampleType::U8,
        SampleType::I8,
        SampleType::U16,
        SampleType::I16,
        SampleType::U32,
        SampleType::I32,
        SampleType::F32,
        SampleType::F64,
    ];

    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            SampleType::U8 | SampleType::I8 => 1,
            SampleType::U16 | SampleType::I16 => 2,
            SampleType::U32 | SampleType::I32 | SampleType::F32 => 4,
            SampleType::F64 => 8,
        }
    }

    /// Bits of one sample.
    pub const fn bits(self) -> u32 {
        match self {
            SampleType::U8 | SampleType::I8 => 8,
            SampleType::U16 | SampleType::I16 => 16,
            SampleType::U32 | SampleType::I32 | SampleType::F32 => 32,
            SampleType::F64 => 64,
        }
    }

    /// "u8", "i16", "f32" and so on.
    pub const fn name(self) -> &'static str {
        match self {
            SampleType::U8 => "u8",
            SampleType::I8 => "i8",
            SampleType::U16 => "u16",
            SampleType::I16 => "i16",
            SampleType::U32 => "u32",
            SampleType::I32 => "i32",
            SampleType::F32 => "f32",
            SampleType::F64 => "f64",
        }
    }

    /// Lowest and highest value of an integer type; `None` for a floating-point one.
    pub const fn integer_range(self) -> Option<(f64, f64)> {
        match self {
            SampleType::U8 => Some((0.0, 255.0)),
            SampleType::I8 => Some((-128.0, 127.0)),
            SampleType::U16 => Some((0.0, 65_535.0)),
            SampleType::I16 => Some((-32_768.0, 32_767.0)),
            SampleType::U32 => Some((0.0, 4_294_967_295.0)),
            SampleType::I32 => Some((-2_147_483_648.0, 2_147_483_647.0)),
            SampleType::F32 | SampleType::F64 => None,
        }
    }
}

/// A sample's machine type.
pub trait Sample: Pod + PartialOrd + Send + Sync {
    /// Its tag.
    const TYPE: SampleType;
    /// Its value; exact for every supported type.
    fn to_f64(self) -> f64;
    /// Its value in single precision; exact up to 24 significant bits.
    fn to_f32(self) -> f32;
    /// Its bits as an index, if it has 8 or 16 and is a whole number.
    fn small_bits(self) -> Option<usize>;
    /// The sample of these bits, of which a sample of 8 bits has the lower ones.
    ///
    /// # Panics
    /// If the type has more than 16 bits.
    fn from_small_bits(bits: u16) -> Self;
    /// Returns a buffer of these samples.
    fn into_samples(samples: Vec<Self>) -> Samples;
    /// The samples, if they are of this type.
    fn slice_of(samples: &Samples) -> Option<&[Self]>;
    /// Lowest and highest sample that is a finite number.
    const ENDS: [Self; 2];
    /// A sample at or below `value`, or the lowest; close to it.
    fn below(value: f64) -> Self;
    /// A sample at or above `value`, or the highest; close to it.
    fn above(value: f64) -> Self;
}

macro_rules! samples {
    ($($variant:ident $type:ty),*) => {
        $(impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation, clippy::unnecessary_cast, reason = "rounding is the contract")]
            fn to_f32(self) -> f32 {
                self as f32
            }
            #[inline(always)]
            fn small_bits(self) -> Option<usize> {
                match *bytemuck::bytes_of(&self) {
                    [a] => Some(usize::from(a)),
                    [a, b] => Some(usize::from(u16::from_ne_bytes([a, b]))),
                    _ => None,
                }
            }
            #[inline(always)]
            fn from_small_bits(bits: u16) -> $type {
                let [low, high] = bits.to_le_bytes();
                match size_of::<$type>() {
                    1 => bytemuck::pod_read_unaligned(&[low][..size_of::<$type>().min(1)]),
                    _ => bytemuck::pod_read_unaligned(&u16::from_le_bytes([low, high]).to_ne_bytes()[..]),
                }
            }
            fn into_samples(samples: Vec<$type>) -> Samples {
                Samples::$variant(samples)
            }
            fn slice_of(samples: &Samples) -> Option<&[$type]> {
                match samples {
                    Samples::$variant(samples) => Some(samples),
                    _ => None,
                }
            }
            const ENDS: [$type; 2] = [<$type>::MIN, <$type>::MAX];
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::unnecessary_cast, reason = "saturates")]
            fn below(value: f64) -> $type {
                let near = value as $type;
                // Rounding to single precision, or toward 0, may have gone up: by less than the step down.
                if f64::from(near) > value { (value - value.abs() * 1e-6 - 1.0) as $type } else { near }
            }
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::unnecessary_cast, reason = "saturates")]
            fn above(value: f64) -> $type {
                let near = value as $type;
                if f64::from(near) < value { (value + value.abs() * 1e-6 + 1.0) as $type } else { near }
            }
        })*

        /// A buffer of samples of one type, native endian.
        #[derive(Debug, Clone, PartialEq)]
        #[expect(missing_docs, reason = "the names say it")]
        pub enum Samples {
            $($variant(Vec<$type>)),*
        }

        impl Samples {
            /// `len` zeros of type `ty`.
            pub fn zeros(ty: SampleType, len: usize) -> Samples {
                match ty {
                    $(SampleType::$variant => Samples::$variant(vec![<$type>::default(); len])),*
                }
            }

            /// The type of its samples.
            pub fn sample_type(&self) -> SampleType {
                match self {
                    $(Samples::$variant(_) => SampleType::$variant),*
                }
            }

            /// How many samples.
            pub fn len(&self) -> usize {
                match self {
                    $(Samples::$variant(v) => v.len()),*
                }
            }

            /// The samples' bytes in native order, for reading into.
            pub fn bytes_mut(&mut self) -> &mut [u8] {
                match self {
                    $(Samples::$variant(v) => bytemuck::cast_slice_mut(v)),*
                }
            }

            /// The samples' bytes in native order.
            pub fn bytes(&self) -> &[u8] {
                match self {
                    $(Samples::$variant(v) => bytemuck::cast_slice(v)),*
                }
            }

            /// Sample `index` as a number.
            ///
            /// # Panics
            /// If `index` is not below [`Samples::len`].
            pub fn get(&self, index: usize) -> f64 {
                match self {
                    $(Samples::$variant(v) => v[index].to_f64()),*
                }
            }
        }
    };
}

samples!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64);

impl Samples {
    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reverses the bytes of each sample, for data of the other endianness.
    pub fn swap_bytes(&mut self) {
        let width = self.sample_type().bytes();
        for sample in self.bytes_mut().chunks_exact_mut(width) {
            sample.reverse();
        }
    }
}

/// Runs `$body` with `$slice` bound to the typed slice inside a [`Samples`]: one copy of the code per type.
#[macro_export]
macro_rules! with_samples {
    ($samples:expr, $slice:ident => $body:expr) => {
        match $samples {
            $crate::volume::Samples::U8($slice) => $body,
            $crate::volume::Samples::I8($slice) => $body,
            $crate::volume::Samples::U16($slice) => $body,
            $crate::volume::Samples::I16($slice) => $body,
            $crate::volume::Samples::U32($slice) => $body,
            $crate::volume::Samples::I32($slice) => $body,
            $crate::volume::Samples::F32($slice) => $body,
            $crate::volume::Samples::F64($slice) => $body,
        }
    };
}

/// Runs `$body` with `$T` standing for the machine type of a [`SampleType`]: one copy of the code per type.
#[macro_export]
macro_rules! with_sample_type {
    ($sample_type:expr, $T:ident => $body:expr) => {
        match $sample_type {
            $crate::volume::SampleType::U8 => {
                type $T = u8;
                $body
            }
            $crate::volume::SampleType::I8 => {
                type $T = i8;
                $body
            }
            $crate::volume::SampleType::U16 => {
                type $T = u16;
                $body
            }
            $crate::volume::SampleType::I16 => {
                type $T = i16;
                $body
            }
            $crate::volume::SampleType::U32 => {
                type $T = u32;
                $body
            }
            $crate::volume::SampleType::I32 => {
                type $T = i32;
                $body
            }
            $crate::volume::SampleType::F32 => {
                type $T = f32;
                $body
            }
            $crate::volume::SampleType::F64 => {
                type $T = f64;
                $body
            }
        }
    };
}
