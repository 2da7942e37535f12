"""What a diagnosis says of joints' recordings beside its verdict: mistakes of data, repairs, the scale of efforts."""
