"""Readers: whatever a test rig writes, as typed input. Import from the modules: video brings PyAV with it."""
