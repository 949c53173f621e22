# SPDX-License-Identifier: Apache-2.0
"""What a cable's equations hold beside bending, one file an effect; `registry` lists them."""
