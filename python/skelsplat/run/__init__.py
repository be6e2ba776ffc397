"""One whole run as a library: files in; poses, findings, a report, figures and files out."""
