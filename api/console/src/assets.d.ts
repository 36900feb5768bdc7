/** The address of a picture that the build puts beside the page. */
declare module "*.svg" {
  const address: string;
  export default address;
}
