//! Files: scans in, results out; the only module that opens files.
