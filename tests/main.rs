mod vdb;
