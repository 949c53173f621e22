"""What a cable's equations hold beside bending, one file an effect; `registry` lists them."""
