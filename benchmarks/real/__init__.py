"""Diagnosis of real recordings against what is known of them."""
