//! Files that are larger than memory, and than 2^32 records.

mod huge;
mod lowmem;
